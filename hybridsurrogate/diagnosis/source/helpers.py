"""Functions that are the same in all modules that need them."""

from __future__ import annotations

HELPERS = {
    "rows": '''def rows(*values):
    """Return values as arrays of floats of one shape."""
    values = np.broadcast_arrays(*(np.atleast_1d(value) for value in values))
    return [np.array(value, dtype=float) for value in values]''',
    "by_name": '''def by_name(values, axis=-1):
    """Return outputs by name, from a dict, a list or an array with outputs along an axis."""
    if isinstance(values, dict):
        return {name: values[name] for name in OUTPUTS}
    if not isinstance(values, tuple | list):
        values = np.moveaxis(np.asarray(values), axis, 0)
    return dict(zip(OUTPUTS, values, strict=True))''',
    "logistic": '''def logistic(x):
    """Return 1 / (1 + exp(-x)), which does not overflow here."""
    return (1 + np.tanh(x / 2)) / 2''',
    "each_row": '''def each_row(simulation, **values):
    """Run a simulation that takes numbers once for each row."""
    rows_of = zip(*(np.ravel(value).tolist() for value in values.values()), strict=True)
    return np.array([simulation(**dict(zip(values, own, strict=True))) for own in rows_of])''',
    "in_curves": '''def in_curves(simulation, **values):
    """Run a simulation that returns a curve over its first input, once for equal rows."""
    (name, places), *others = values.items()
    numbers = np.array([value for _, value in others]).reshape(len(others), len(places))
    output = [None] * len(places)
    for own in np.unique(numbers, axis=1).T:
        here = np.flatnonzero(np.all(numbers == own[:, None], axis=0))
        at, back = np.unique(places[here], return_inverse=True)
        given = {key: value for (key, _), value in zip(others, own, strict=True)}
        curve = np.asarray(simulation(**{name: at}, **given))
        for k, row in enumerate(here):
            output[row] = curve[..., back[k]]
    return np.moveaxis(np.array(output), 0, -1)''',
    "by_level": '''def by_level(values, table, other=0.0):
    """Return the number of each row's level, and a default for levels not in the table."""
    for level, number in table.items():
        other = np.where(values == level, number, other)
    return other''',
    "curve_of_level": '''def curve_of_level(values, by, levels, grid, curves):
    """Return the curve of each row's level at its value, zero for other levels."""
    out = np.zeros(np.shape(values))
    for level, curve in zip(levels, curves, strict=True):
        out = np.where(by == level, np.interp(values, grid, curve), out)
    return out''',
}
