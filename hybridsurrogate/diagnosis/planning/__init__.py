"""What planned measurements would show, before they are made.

detectability  rates at which causes of some sizes would be detected and named
result         the rates: tables, a picture, a report
"""
