"""The PHANToM Premium 1.5A in numpy: kinematics, dynamics, parameter sets, and what they say of the arm.

Written independently of the FMU PhantomArm; tests/test_arm_fmu.py holds the two together. MISPRINTS.md lists where
the papers are wrong and which test shows it.
"""
