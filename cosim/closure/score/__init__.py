"""What a candidate is worth: evidence on blocks, errors, noise floor, selection, dependences of the residual."""
