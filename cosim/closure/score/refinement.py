"""The nonlinear parameters of one screened law, moved from the best value of its grid to that of most nats."""

import numpy as np
from attrs import evolve

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.score.screen import Screened
from cosim.effects.actuator import Erasing, Late
from cosim.effects.motion import Theta

TRIALS = 20  # times one more than the number of nonlinear parameters
REACH = 0.5  # largest change of a nonlinear parameter at once
STEPS = (0.25, 0.12, 0.06, 0.03)  # of a search along one


def refined(screened: Screened) -> ChosenEffect:
    """The choice with its continuous nonlinear parameters moved to the most nats: of the whole model along a line for
    lag, delay, saturation and dead band, else of a screening (Nelder, Mead 1965). Only physical values count. Its
    screen remembers it.
    """
    choice, known = screened.choice, screened.screen.best
    free = choice.effect.continuous(choice.theta)
    if not free:
        return choice
    key = choice.key, choice.theta
    if key not in known:
        known[key] = _along(screened) if isinstance(choice.effect, Late | Erasing) else _simplex(screened, free)
    return known[key]


def _along(screened: Screened) -> ChosenEffect:
    model, choice = screened.screen.model, screened.choice
    known: dict[Theta, float] = {}

    def score(theta: Theta) -> float:
        if theta not in known:
            trial = evolve(choice, theta=theta)
            new = evolve(model, choices=(*model.choices, trial), seen=model.scene)
            known[theta] = -np.inf if screened.screen.why_not(trial, np.zeros(0)) else new.score()
        return known[theta]

    best = choice.theta
    for step in STEPS:
        best = max((best, *(choice.effect.moved(best, 0, s) for s in (step, -step / (1 + step)))), key=score)
    return evolve(choice, theta=best)


def _simplex(screened: Screened, free: tuple[int, ...]) -> ChosenEffect:
    from scipy.optimize import minimize

    screen, choice, effect = screened.screen, screened.choice, screened.choice.effect
    seen: dict[Theta, float] = {choice.theta: float(screened.gain[0])}
    near = effect.near(screen.model.scene, choice.theta)

    def loss(x: np.ndarray) -> float:
        theta = near(np.clip(x, -REACH, REACH).tolist())
        trial = evolve(choice, theta=theta)
        found = screen.added(screen.columns_now(trial), effect)
        if found is None or screen.why_not(trial, found.beta[:, 0]):
            return 0.0
        seen[theta] = float(found.nats(np.array([0]))[0])
        return -seen[theta]

    simplex = np.vstack([np.zeros(len(free)), 0.1 * np.eye(len(free))])
    options = {"initial_simplex": simplex, "maxfev": TRIALS * (1 + len(free)), "xatol": 3e-3, "fatol": 0.5}
    minimize(loss, simplex[0], method="Nelder-Mead", options=options)
    return evolve(choice, theta=max(seen, key=seen.__getitem__))
