"""The recording prepared for regression: smoothed motion, rows, friction laws, rigid body, the regression problem."""
