"""Identification: excitation, regressors, estimates, their intervals, and which parameters the data determine."""
