"""Every constant that decides what `close-loop` answers. All other numbers are bounds of physical parameters, grids to
start a search from, or numerics; `tests/closure/test_constants.py` lists them.

Each stands with its meaning, its source, and what happens when it is doubled.
"""

ALPHA = 0.01
"""Share of complete recordings on which a law, or a nameless family, may be claimed: the quantile of the largest gain
of the whole library under the null. Source: what a user bears who closes the loop a hundred times. Doubled: about twice
as many false claims, a twentieth less is needed to be seen."""

SIZE = 0.002
"""Smallest effect of interest, as a share of the torque's RMS. Source: smoothing and differentiating alone make up to
0.0014 on 108 complete recordings of four generators. Doubled: effects of a noise floor or two of a clean recording go
unnamed."""

MARGIN = 0.15
"""Share of what can be explained on a joint, in nats, that a name may miss, and that a further name has to earn: how
far the form of a law is from that of a real effect. Source: forms of friction laws of the literature fitted to one
another. Doubled: wrong names for effects that no library has. Halved: true names are withdrawn for their form."""

SAME = 2.0
"""Standard errors of paired differences of blocks up to which two hypotheses are not told apart. Source: 95 % of a
normal difference. Doubled: twice as many names with doubt."""

FREEDOM = 10.0
"""Degrees of freedom of a block's own noise level (multivariate t): how far one block may speak for all. Source:
robustness without loss, Lange, Little, Taylor 1989. Doubled: a spike in one block weighs up to twice as much."""

SMALL = 0.05
"""A small share: of the rows in motion whose torque an effect may erase (beyond a limit, within a dead band) and still
be named for sure, since what is erased cannot contradict; of the torque that may be left unexplained however little the
sensors' noise is. Source: the usual level of a test. Doubled: saturated loops get sure names, and a tenth of the torque
may stay unexplained without a word."""

HALF = 0.5
"""Half: of a joint's torque that a model must explain before effects are added to it; of what is left that a few rows
hold where it is an event. Source: the word. Doubled: names on models that explain nothing; no events."""

NOISE = 4.0
"""Times the variance of the sensors' own noise that a residual may have, on fitted rows and on rows kept for the
report. Source: complete recordings leave at most 1.1 times. Doubled: what only the reported rows show is called
complete."""

EVENT = 0.02
"""Few rows: half of what is left within fewer is an event, told with its time, and no law's work; a direction of motion
that fewer rows go is not seen. Source: a sixth of the 13 % that hold half in normal noise. Doubled: motions with few
reversals have events."""

FED_BACK = 0.3
"""Of what the noise of an encoder leaves in a residual, squared: the share that a controller feeds back, so that a lag
explains it; a spring smooths the rest as well. Source: complete recordings reach 0.25. Doubled: where encoders make
most of the residual, a true lag has to show by 1.2 noise floors, now by 0.65."""
