"""The command line ``hybridsurrogate``.

main         from words to exit code; parsers
reference    the reference page
commands     every command, its options and an example
options      what an option is
priors       priors and assumed constants as words
study        simulation and measurements from what was named, in words or in TOML
user_code    the user's Python file, and what was saved with it
diagnoses    demo, diagnose, report, next-runs
comparisons  compare
fits         fit, predict, choose-beta
output       texts, files, stages
"""
