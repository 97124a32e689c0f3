"""A model.c compiled without FMI: struct and tables as in its FMU, Runge-Kutta of the glue, called through ctypes.

The tests use it to reach one derivative or one step of a model; what a user gets (FMUs) is tested beside it.
"""

import ctypes
import hashlib
import math
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from build_fmus.header import header
from build_fmus.sources import model_table
from tests.support.paths import SOURCES

FLAGS = [
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-fPIC",
    "-shared",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Werror",
]

GLUE = """
#include "variable.h"
{header}
#include "refuse.h"
#include "{model}/model.c"
#include "defaults.h"
#define MOST_STATES (N_STATES + 1)
#include "runge_kutta.h"

static const char *failed;
int harness_size_of(void) {{
    (void)variables, (void)slope_of, (void)computed_at, (void)state_at, (void)derivative_at;
    return (int)sizeof(Model);
}}
const char *harness_failure(void) {{ return failed; }}
int harness_begin(Model *m) {{ failed = start(m); if (!failed) outputs(m, 0); return failed != NULL; }}
void harness_show(Model *m, double t) {{ outputs(m, t); }}
#if MODEL_CONTINUOUS
typedef struct {{ Model *m; double start; }} Motion;
void harness_rates(Model *m, double t) {{ derivatives(m, t); }}
static void rates(void *system, double offset, const double *at, double *k)
{{
    const Motion *motion = system;
    double *v = (double *)motion->m;
    for (int i = 0; at && i < N_STATES; i++) v[state_at[i]] = at[i];
    derivatives(motion->m, motion->start + offset);
    for (int i = 0; i < N_STATES; i++) k[i] = v[derivative_at[i]];
}}
static void integrate(Model *m, double start_time, double offset, double h)
{{
    Motion motion = {{m, start_time}};
    double *v = (double *)m, s[N_STATES];
    for (int i = 0; i < N_STATES; i++) s[i] = v[state_at[i]];
    runge_kutta(rates, &motion, N_STATES, s, offset, h);
    for (int i = 0; i < N_STATES; i++) v[state_at[i]] = s[i];
}}
#endif
/* n steps; inputs[n][width] go to the doubles input_at before each step, record[n][count] takes watched ones after. */
int harness_steps(Model *m, double t0, double step, int n, const double *inputs, int width, const int *input_at,
          double *record, int count, const int *watch)
{{
    for (int k = 0; k < n; k++) {{
        for (int i = 0; i < width; i++) ((double *)m)[input_at[i]] = inputs[k * width + i];
        const double t = t0 + k * step;
        m->step = step;
#if MODEL_CONTINUOUS
        const int internal = (int)INTERNAL_STEPS(m);
        for (int j = 0; j < internal; j++) integrate(m, t, step * j / internal, step / internal);
#endif
        failed = sample(m, t + step);
        if (failed) return k + 1;
        outputs(m, t + step);
        for (int i = 0; i < count; i++) record[k * count + i] = ((double *)m)[watch[i]];
    }}
    return 0;
}}
"""


def _compiler() -> list[str]:
    return (
        [os.environ["CC"]]
        if "CC" in os.environ
        else ["cc"]
        if shutil.which("cc")
        else [sys.executable, "-m", "ziglang", "cc"]
    )


def compile_library(source: str, flags: tuple[str, ...] = ()) -> ctypes.CDLL:
    """The C text as a shared library; one file per content."""
    key = hashlib.sha256(source.encode() + repr(flags).encode()).hexdigest()[:16]
    headers = hashlib.sha256(b"".join(p.read_bytes() for p in sorted(SOURCES.rglob("*.[ch]")))).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"model_harness_{os.getuid() if hasattr(os, 'getuid') else 0}"
    folder.mkdir(exist_ok=True)
    library = folder / f"{key}_{headers}.so"
    if not library.exists():
        code = folder / f"{key}_{os.getpid()}.c"
        code.write_text(source)
        made = library.with_suffix(f".{os.getpid()}")
        subprocess.run(
            [
                *_compiler(),
                *FLAGS,
                *flags,
                f"-I{SOURCES}",
                f"-I{SOURCES / 'shared'}",
                str(code),
                "-o",
                str(made),
                "-lm",
            ],
            check=True,
        )
        made.replace(library)
    return ctypes.CDLL(str(library))


class CompiledModel:
    """One instance of a model: `m["q_start"] = ...`, `m.start()`, `m.run(...)`."""

    def __init__(self, model: str, **parameters):
        self.table = table = model_table(model)
        code = (SOURCES / model / "model.c").read_bytes()
        self.source = GLUE.format(header=header(table, code), model=model)
        self._library = compile_library(self.source)
        self._library.harness_failure.restype = ctypes.c_char_p
        sizes = {v.name: v.width for v in table.variable} | {
            p.name: math.prod(table.shape(p.name)) for p in table.private
        }
        ends = np.cumsum(list(sizes.values()))
        self._places = {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends)}
        self._public = len(table.scalars)
        self.memory = np.zeros(int(ends[-1]) + 34)  # origin, step, text
        assert self._library.harness_size_of() == self.memory.nbytes
        self.memory[: self._public] = [s.start for s in table.scalars]
        self.time = 0.0
        for name, value in parameters.items():
            self[name] = value

    def _indices(self, name: str) -> list[int]:
        place = self._places[name]
        return list(range(place.start, place.stop))

    def __setitem__(self, name, value):
        self.memory[self._places[name]] = value

    def __getitem__(self, name):
        return self.memory[self._places[name]].copy()

    def _pointer(self):
        return self.memory.ctypes.data_as(ctypes.c_void_p)

    def start(self) -> "CompiledModel":
        """start() on zeroed private state, as the glue calls it."""
        self.memory[self._public :] = 0.0
        self.time = 0.0
        if self._library.harness_begin(self._pointer()):
            raise ValueError(self._library.harness_failure().decode())
        return self

    def rates(self, t: float = 0.0) -> None:
        self._library.harness_rates(self._pointer(), ctypes.c_double(t))

    def show(self, t: float = 0.0) -> None:
        self._library.harness_show(self._pointer(), ctypes.c_double(t))

    def run(
        self, steps: int, step: float, inputs: dict[str, np.ndarray] | None = None, watch: tuple[str, ...] = ()
    ) -> dict:
        """Steps with inputs[name] of shape (steps, size), held over each step; watched variables after each step."""
        inputs = inputs or {}
        where = [i for name in inputs for i in self._indices(name)]
        values = np.ascontiguousarray(
            np.hstack(
                [
                    np.broadcast_to(
                        np.asarray(v, float).reshape(-1, len(self._indices(k))), (steps, len(self._indices(k)))
                    )
                    for k, v in inputs.items()
                ]
            )
            if inputs
            else np.zeros((steps, 1))
        )
        look = [i for name in watch for i in self._indices(name)]
        record = np.zeros((steps, max(1, len(look))))

        def pack(a):
            return np.array(a or [0], np.int32)

        at, see = pack(where), pack(look)

        def point(a):
            return a.ctypes.data_as(ctypes.c_void_p)

        failed = self._library.harness_steps(
            self._pointer(),
            ctypes.c_double(self.time),
            ctypes.c_double(step),
            steps,
            point(values),
            len(where),
            point(at),
            point(record),
            len(look),
            point(see),
        )
        if failed:
            raise ValueError(self._library.harness_failure().decode())
        self.time += steps * step
        result, column = {}, 0
        for name in watch:
            size = len(self._indices(name))
            result[name] = record[:, column : column + size]
            column += size
        return result
