"""One forward dynamics of a seven-joint arm: ours (articulated bodies in C, one step of RK4 by the FMU's code) and
pinocchio's `aba`.

    python -m tests.benchmarks.serial_arm [URDF]      # default: xarm7 of example-robot-data

Pinocchio is called through its Python binding; what the binding costs is measured on a call that computes nothing (an
`aba` of a model of one joint less its share) and printed beside it, never subtracted silently.
"""
