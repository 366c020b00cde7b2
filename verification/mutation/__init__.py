"""Mutation tests of the modules that a stop depends on: each small change must fail a test.

`python -m verification.mutation` changes one operator, constant, condition or statement at a time
and runs the unit tests of that module. A change that no test notices has survived; each survivor is
either killed by a new test or listed in `equivalent.toml` with the reason why nothing can notice
it.

This is no library, for these reasons (checked: mutmut 3.8, cosmic-ray 8.7; mutatest is no longer
maintained):

- mutmut forks per mutant, too, but changes only bodies of functions without decorators: constants
  of a module (limits, the table of failsafes, the table of commands) and properties stay as they
  are, and it knows no deletion of a call or of a condition.
- cosmic-ray rewrites the source file in place and starts an interpreter with all imports for each
  mutant: half an hour instead of some minutes, and nothing else may use the checkout meanwhile.
- Neither has a list of equivalent mutants with reasons that is checked for stale entries. Both
  exempt whole lines by comments in the product's code.
"""
