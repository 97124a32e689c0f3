"""The PHANToM Premium 1.5A in numpy: kinematics, dynamics, parameter sets, workspace, counterbalance.

Written independently of the FMU PhantomArm; tests/fmu_src/test_arm_fmu.py compares the two. MISPRINTS.md lists where
the papers are wrong and which test shows it.
"""
