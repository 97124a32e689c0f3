"""What `import cosim` gives: each main command as a function whose result answers in numpy arrays, tables and figures.

The command line calls these functions and prints their results; `cosim/__init__.py` gives them out by name, lazily.
"""
