"""Stability of the loop: growth of small disturbances, criteria, the exact spectrum, margins."""
