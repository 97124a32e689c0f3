"""The loop closed with measured data: residual, missing effect, effect added, error before and after."""
