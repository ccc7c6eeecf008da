"""The command line ``hybridsurrogate``.

main            from words to exit code
parsers         argparse, with a question for a misspelt word
commands        every command, its options and an example
options         what an option is
study_file      options in TOML
study           simulation and measurements from what was named
priors          priors as words
user_code       the user's Python file, and what was saved with it
diagnoses       demo, diagnose, report, next-runs
comparisons     compare
fits            fit, predict, choose-beta
output          texts, files, stages
reference       the reference page
"""
