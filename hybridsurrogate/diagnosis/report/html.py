"""One HTML page that needs no network: style and pictures are inside it."""

from __future__ import annotations

import base64
import html

import pandas as pd

from hybridsurrogate.diagnosis.report.section import Section

_STYLE = """
:root{color-scheme:light dark;--ink:#1b1b1b;--paper:#fff;--line:#ccc;--code:#f3f3f3}
@media (prefers-color-scheme:dark){:root{--ink:#e8e8e8;--paper:#161616;--line:#444;--code:#242424}}
body{font:1rem/1.55 system-ui,sans-serif;max-width:46rem;margin:0 auto;padding:1rem;
color:var(--ink);background:var(--paper);overflow-wrap:break-word}
h1{font-size:1.5rem;line-height:1.25}h2{font-size:1.2rem;margin:2rem 0 .5rem}
figure{margin:1rem 0}img{display:block;max-width:100%;height:auto;background:#fff}
figcaption,caption{font-size:.85rem;text-align:left;opacity:.8;padding:.3rem 0}
.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}
th,td{text-align:left;padding:.25rem .9rem .25rem 0;border-bottom:1px solid var(--line)}
pre{background:var(--code);padding:.6rem;overflow-x:auto;white-space:pre-wrap}
@media print{:root{--ink:#000;--paper:#fff;--line:#999;--code:#fff;color-scheme:light}
body{max-width:none}figure,tr,pre{break-inside:avoid}h2{break-after:avoid}}
""".replace("\n", "")


def page(title: str, sections: tuple[Section, ...], note: str = "") -> str:
    """Return a whole page.

    Parameters
    ----------
    title : str
    sections : tuple of Section
    note : str
        A last line, such as a citation.
    """
    name = html.escape(title)
    foot = f"<footer><p><small>{html.escape(note)}</small></p></footer>" if note else ""
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{name}</title><style>{_STYLE}</style></head>\n"
        f"<body><main><h1>{name}</h1>\n{fragment(sections)}</main>{foot}</body></html>\n"
    )


def fragment(sections: tuple[Section, ...]) -> str:
    """Return the sections alone, for a page that has a style of its own."""
    return "\n".join(_section(section) for section in sections)


def _section(section: Section) -> str:
    parts = [f"<section><h2>{html.escape(section.title)}</h2>"]
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in section.sentences]
    for name, formula in section.formulas:
        parts.append(f"<p>{html.escape(name)}:</p><pre><code>{html.escape(formula)}</code></pre>")
    if section.table is not None:
        parts.append(_table(section.table, section.caption))
    for description, png in section.pictures:
        data = base64.b64encode(png).decode()
        told = html.escape(description, quote=True)
        parts.append(
            f'<figure><img alt="{told}" src="data:image/png;base64,{data}">'
            f"<figcaption>{told}</figcaption></figure>"
        )
    return "\n".join([*parts, "</section>"])


def _table(table: pd.DataFrame, caption: str) -> str:
    head = "".join(f'<th scope="col">{html.escape(str(name))}</th>' for name in table.columns)
    rows = "".join(
        f"<tr>{''.join(f'<td>{html.escape(str(cell))}</td>' for cell in row)}</tr>"
        for row in table.itertuples(index=False)
    )
    told = f"<caption>{html.escape(caption)}</caption>" if caption else ""
    return (
        f'<div class="wide"><table>{told}<thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )
