"""A rig that makes "measured" runs: its own dynamics, friction laws, controller, encoders and noise.

Nothing here imports `cosim`: the equations are written out a second time, and where the literature has several laws for
one effect the rig uses other ones than the tool's library (elasto-plastic elements for presliding, two Coulomb levels
for an asymmetry, a warm-up with a time of its own for drift), so that the tool is not tested on its own equations.
"""
