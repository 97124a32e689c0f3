"""The model with chosen effects: its columns, its fit, candidates with and without a name."""
