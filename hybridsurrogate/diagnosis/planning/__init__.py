"""What planned measurements would show, before they are made.

detectability  rates at which causes of some sizes would be detected and named
planned        planned rows as places at which data are simulated
result         the rates: tables, a picture, a report
"""
