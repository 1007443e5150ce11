"""What `python -m zoo.doctor` looks at.

A doctor is called where things are missing: outside of functions these modules import nothing that
has to be installed, and their annotations are not evaluated, so that an old Python gets an answer.
"""
