"""Batch sweeps of stability: what is asked for, who computes it, what is kept, where the boundary runs."""
