"""A model.c compiled without FMI: struct from model.toml, RK4 as the glue does it, called through ctypes.

The tests use it to reach one derivative or one step of a model; what a user gets (FMUs) is tested beside it.
"""

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np

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
#include <math.h>
#include <string.h>
typedef struct {{
{fields}
    double origin, step, text[32];
}} Model;
{enumerations}
#include "{model}/model.c"
#define STATES {states}
static const int state_at[] = {{ {state_at} 0 }}, rate_at[] = {{ {rate_at} 0 }};
static const char *failed;
int harness_size_of(void) {{ return (int)sizeof(Model); }}
const char *harness_failure(void) {{ return failed; }}
int harness_begin(Model *m) {{ failed = start(m); if (!failed) outputs(m, 0); return failed != NULL; }}
void harness_rates(Model *m, double t) {{ {derive} }}
void harness_show(Model *m, double t) {{ outputs(m, t); }}
static void integrate(Model *m, double t, double offset, double h)
{{
    double *v = (double *)m, s[STATES + 1], k[4][STATES + 1];
    for (int i = 0; i < STATES; i++) s[i] = v[state_at[i]];
    for (int n = 0; n < 4; n++) {{
        const double part = n == 0 ? 0 : n == 3 ? h : 0.5 * h;
        for (int i = 0; i < STATES; i++) v[state_at[i]] = n == 0 ? s[i] : s[i] + part * k[n - 1][i];
        harness_rates(m, t + (offset + part));
        for (int i = 0; i < STATES; i++) k[n][i] = v[rate_at[i]];
    }}
    for (int i = 0; i < STATES; i++) v[state_at[i]] = s[i] + h / 6.0 * (k[0][i] + 2.0 * (k[1][i] + k[2][i]) + k[3][i]);
}}
/* n steps; inputs[n][width] go to the doubles input_at before each step, record[n][count] takes watched ones after. */
int harness_steps(Model *m, double t0, double step, int n, const double *inputs, int width, const int *input_at,
          double *record, int count, const int *watch)
{{
    for (int k = 0; k < n; k++) {{
        for (int i = 0; i < width; i++) ((double *)m)[input_at[i]] = inputs[k * width + i];
        const double t = t0 + k * step;
        const int internal = {internal};
        m->step = step;
        for (int j = 0; j < internal && STATES > 0; j++) integrate(m, t, step * j / internal, step / internal);
        failed = sample(m, t + step);
        if (failed) return k + 1;
        outputs(m, t + step);
        for (int i = 0; i < count; i++) record[k * count + i] = ((double *)m)[watch[i]];
    }}
    return 0;
}}
"""


def _table(model: str) -> list[dict]:
    folder = SOURCES / model
    table = tomllib.loads((folder / "model.toml").read_text())
    variables = list(table["variable"])
    for include in table.get("include", []):
        for variable in tomllib.loads((folder / include["file"]).read_text())["variable"]:
            variables.append(variable | ({"size": include["size"]} if "size" in include else {}))
    return variables + [entry | {"causality": "private"} for entry in table.get("private", [])]


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
        self._places: dict[str, slice] = {}
        table, at, fields = _table(model), 0, []
        for entry in table:
            size = entry.get("size", 1)
            self._places[entry["name"]] = slice(at, at + size)
            fields.append(f"    double {entry['name']}{f'[{size}]' if 'size' in entry else ''};")
            at += size
        states = [entry for entry in table if entry["causality"] == "state"]
        state_at = [i for e in states for i in self._indices(e["name"])]
        rate_at = [i for e in states for i in self._indices(e["derivative"])]
        choices = [f"{e['name']}_{item} = {i + 1}" for e in table for i, item in enumerate(e.get("items", []))]
        self.source = source = GLUE.format(
            enumerations=f"enum {{ {', '.join(choices).upper()} }};" if choices else "",
            fields="\n".join(fields),
            model=model,
            states=len(state_at),
            state_at="".join(f"{i}, " for i in state_at),
            rate_at="".join(f"{i}, " for i in rate_at),
            internal="(int)m->internal_steps" if "internal_steps" in self._places else "1",
            derive="derivatives(m, t);" if states else "(void)m; (void)t;",
        )
        self._library = compile_library(source)
        self._public = at - sum(e.get("size", 1) for e in table if e["causality"] == "private")
        at += 34  # origin, step, text
        self._library.harness_failure.restype = ctypes.c_char_p
        assert self._library.harness_size_of() == 8 * at
        self.memory = np.zeros(at)
        for entry in table:
            self.memory[self._places[entry["name"]]] = entry.get("start", 0.0)
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
