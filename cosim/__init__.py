"""Co-simulation of haptic teleoperation: scenarios, master algorithm, stability, identification, the loop closed with
data.
"""
