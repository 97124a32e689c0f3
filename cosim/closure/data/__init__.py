"""The recording as the closed loop sees it: smoothed motion, rows, friction laws, pose of the problem."""
