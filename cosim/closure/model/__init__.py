"""The model that is fitted to a recording: its motion and rows, friction laws, columns of effects, candidates."""
