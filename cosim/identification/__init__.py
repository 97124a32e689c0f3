"""Identification: excitation, regressors, estimates, intervals, what the data can and cannot show."""
