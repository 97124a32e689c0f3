"""How candidates are judged: evidence on blocks, errors, noise floor, selection, dependences of the residual."""
