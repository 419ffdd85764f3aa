"""The functions of the package that users call: each takes files or arrays and gives a result of arrays.

`verbs` has the functions, `results` what they give, `sources` turns what they are given into what the stages read.
The command line takes its names, defaults and help texts from here.
"""
