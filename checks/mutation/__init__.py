"""Mutation tests of the modules that an emergency stop depends on.

`python -m checks.mutation` changes one operator, constant, condition or statement at a time
and runs the unit tests of that module. A mutant that no test detects has survived. Each survivor is
killed by a new test, or listed in `equivalent.toml` with the reason why no test can detect it.

No library fits (checked: mutmut 3.8, cosmic-ray 8.7; mutatest is no longer maintained). mutmut also
forks per mutant, but changes only bodies of functions without decorators: constants of a module
(limits, the tables of failsafes and commands) and properties stay unchanged, and it deletes no call
or condition. cosmic-ray rewrites the source file in place and starts an interpreter with all
imports for each mutant, which takes half an hour instead of minutes and blocks the checkout.
Neither has a list of equivalent mutants with reasons that is checked for stale entries; both exempt
whole lines by comments in product code.
"""
