"""The physics in C under the address and undefined-behaviour sanitizers, with parameters and inputs from their whole
ranges."""

import subprocess

import pytest

from build_fmus.table import ModelTable
from tests.support.model_harness import FLAGS, SOURCES, CompiledModel

MAIN = """
#include <stdio.h>
#include <stdlib.h>
static const struct { int at; double low, high; int whole, input; double start; } rows[] = { %(rows)s };
static unsigned long long state = 88172645463325252ull;
static double uniform(void)
{
    state ^= state << 13; state ^= state >> 7; state ^= state << 17;
    return (double)(state >> 11) / 9007199254740992.0;
}
/* Zero, limits, moderate and (wild) any magnitude of either sign, within the row's range. */
static double draw(int k, int wild)
{
    const double low = rows[k].low, high = rows[k].high;
    const double size = exp(wild ? (uniform() - 0.5) * 1400 : (uniform() - 0.6) * 12);
    const double kind = uniform();
    if (rows[k].whole) return floor(low + uniform() * ((high > 1e6 ? 1e6 : high) - low + 0.999));
    double v = kind < 0.1 ? 0 : kind < 0.13 ? low : kind < 0.16 ? high : kind < 0.6 ? size : -size;
    return v < low ? low : v > high ? high : v;
}
static int finite_states(const Model *m)
{
    for (int k = 0; k < N_STATES; k++) if (!isfinite(((const double *)m)[state_at[k]])) return 0;
    return 1;
}
int main(void)
{
    Model *m = calloc(1, sizeof *m);
    const int n = (int)(sizeof rows / sizeof rows[0]), none[1] = {0};
    double nothing[1] = {0};
    long whole = 0, refused = 0, failed = 0, lost = 0;
    for (int trial = 0; trial < %(trials)d; trial++) {
        const int wild = trial %% 3 == 0;
        const double share = uniform() * uniform(), step = exp((uniform() - 0.7) * 8) * 1e-2;
        memset(m, 0, sizeof *m);
        for (int k = 0; k < n; k++) ((double *)m)[rows[k].at] = uniform() < share ? draw(k, wild) : rows[k].start;
        if (harness_begin(m) || !finite_states(m)) { refused++; continue; }
        int bad = 0;
        for (int s = 0; s < 60 && !bad; s++) {
            for (int k = 0; k < n; k++)
                if (rows[k].input && uniform() < 0.5) ((double *)m)[rows[k].at] = draw(k, wild);
            bad = harness_steps(m, s * step, step, 1, nothing, 0, none, nothing, 0, none);
            if (bad) failed++;
            else if (!finite_states(m)) { lost++; bad = 1; }
        }
        whole += !bad;
    }
    free(m);
    printf("%%ld %%ld %%ld %%ld\\n", whole, refused, failed, lost);
    return 0;
}
"""


def parameter_rows(table: ModelTable) -> str:
    """C rows of every parameter and input: place, range, whether whole, whether input, start value."""
    rows = []
    for scalar in table.of("parameter", "input"):
        v = scalar.variable
        low, high = (-1e308 if v.low is None else v.low), (1e308 if v.high is None else v.high)
        whole, is_input = int(v.type != "Real"), int(v.causality == "input")
        rows.append(f"{{{scalar.reference}, {low!r}, {high!r}, {whole}, {is_input}, {scalar.start!r}}}")
    return ", ".join(rows)


TRIALS = {"SerialArm": 4000}
"""Of ten times as many parameters more are refused together."""


@pytest.mark.slow
@pytest.mark.needs("cc")
@pytest.mark.parametrize(
    "model",
    [
        *("PhantomArm", "SerialArm", "AxisDrive", "VariableDelayChannel", "InverseDynamicsController", "ForceObserver"),
        *("PacketChannel", "PDLikeController", "PassivityController", "TwoLayerController", "ModelMediatedController"),
    ],
)
def test_sanitizers_find_nothing_and_no_state_is_lost(model, tmp_path):
    compiled = CompiledModel(model)
    source = compiled.source.replace("(int)INTERNAL_STEPS(m)", "(int)fmin(INTERNAL_STEPS(m), 8)")
    code, program = tmp_path / "fuzz.c", tmp_path / "fuzz"
    code.write_text(source + MAIN % {"rows": parameter_rows(compiled.table), "trials": TRIALS.get(model, 1500)})
    flags = [f for f in FLAGS if f not in ("-fPIC", "-shared", "-O2")]
    subprocess.run(
        [
            "cc",
            *flags,
            "-O1",
            "-g",
            "-fsanitize=address,undefined,float-cast-overflow",
            "-fno-sanitize-recover=all",
            "-Wno-maybe-uninitialized",  # gcc's flow analysis is lost in the sanitizers' own branches
            f"-I{SOURCES}",
            f"-I{SOURCES / 'shared'}",
            str(code),
            "-o",
            str(program),
            "-lm",
        ],
        check=True,
    )
    done = subprocess.run([str(program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    whole, _refused, _failed, lost = map(int, done.stdout.split())
    # a state is never lost without an error; enough trials run through to mean something
    assert lost == 0 and whole > 300, done.stdout
