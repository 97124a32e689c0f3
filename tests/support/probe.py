"""A model of a few lines for tests of the builder and the glue, and one way to drive an FMU in both FMI versions."""

import ctypes
import tempfile
from pathlib import Path

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave

from build_fmus.build import BuildJob, build
from build_fmus.compiler import this_platform
from build_fmus.table import DefaultExperiment, Head, ModelTable, ModelVariable, Private

MODEL = b"""
/* x' = rate x + u, and an output that takes u at once; private memory counts the samples */
static void derivatives(Model *m, double t) {
    (void)t;
    m->dx[0] = m->rate * m->x[0] + m->u[0];
    m->dx[1] = m->u[1] * m->u[1];
}
static const char *start(Model *m) {
    m->x[0] = m->x_start[0];
    m->x[1] = m->x_start[1];
    return m->rate > 1e3 ? refuse(m, "rate", 0, m->rate, "at most 1000") : NULL;
}
static const char *sample(Model *m, double t) { (void)t; m->count += 1.0; m->spent += m->step; return NULL; }
static void outputs(Model *m, double t) {
    m->y = m->gain * m->x[0] + m->u[0] + (m->on != 0.0 ? 1.0 : 0.0) + t;
    m->samples = m->count;
    m->choice = m->law;
}
"""


def probe_table() -> ModelTable:
    """States x[1..2] with x[1]' = rate x[1] + u[1] and x[2]' = u[2]^2; y = gain x[1] + u[1] + on + t."""
    rows = [
        ModelVariable("u", "input", "input", 2, unit="N"),
        ModelVariable("y", "output", "output", unit="N", feedthrough=["u"]),
        ModelVariable("samples", "output", "communication steps", type="Integer"),
        ModelVariable("choice", "output", "the law again", type="Enumeration", items=["one", "two"], start=1.0),
        ModelVariable("x", "state", "states", 2, unit="N.s", derivative="dx", initial="x_start"),
        ModelVariable("dx", "local", "their derivatives", 2, unit="N"),
        ModelVariable("x_start", "parameter", "start of x", 2, unit="N.s", start=[1.0, 0.0]),
        ModelVariable("rate", "parameter", "rate", unit="1/s", start=-1.0, min=-1e6, max=1e6),
        ModelVariable("gain", "tunable", "gain", unit="1/s", start=2.0),
        ModelVariable("on", "parameter", "a switch", type="Boolean"),
        ModelVariable("law", "parameter", "a choice", type="Enumeration", items=["one", "two"], start=1.0),
        ModelVariable(
            "internal_steps", "parameter", "Runge-Kutta steps", type="Integer", start=2.0, min=1.0, max=100.0
        ),
    ]
    return ModelTable(
        Head("Probe", "a probe", "continuous"), DefaultExperiment(1.0, 0.01), rows, [Private("count"), Private("spent")]
    )


def probe(fmi: int, model: bytes = MODEL) -> Path:
    extra = {"model.c": model, "README.md": b"# Probe\n"}
    return build(BuildJob(probe_table(), fmi, (this_platform(),), extra))


class Importer:
    """One instance of an FMU: variables by name, FMI 2 and FMI 3 alike. Keeps the messages of the FMU."""

    def __init__(
        self,
        path: Path,
        start: dict[str, float] | None = None,
        initialize: bool = True,
        time: float = 0.0,
        unzipped: str | None = None,
    ) -> None:
        self.description = read_model_description(str(path))
        self.two = self.description.fmiVersion == "2.0"
        self.folder = unzipped or extract(str(path), tempfile.mkdtemp(prefix="probe-"))
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.messages: list[str] = []
        kind = FMU2Slave if self.two else FMU3Slave
        self.fmu = kind(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            instanceName="probe",
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )
        self._instantiate()
        self.time = time
        for name, value in (start or {}).items():
            self.set(name, value)
        if initialize:
            self.initialize()

    def _instantiate(self) -> None:
        if self.two:

            def log(environment, name, status, category, message):
                self.messages.append(message.decode())

            self._logger = fmi2CallbackLoggerTYPE(log)
            callbacks = fmi2CallbackFunctions()
            callbacks.logger = self._logger
            self.fmu.instantiate(callbacks=callbacks)
        else:

            def log3(environment, status, category, message):
                self.messages.append(message.decode())

            self.fmu.instantiate(logMessage=log3)

    def initialize(self) -> None:
        if self.two:
            self.fmu.setupExperiment(startTime=self.time)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=self.time)
        self.fmu.exitInitializationMode()

    def reference(self, name: str) -> int:
        return self.variables[name].valueReference

    def set(self, name: str, value: float) -> None:
        kind = self.variables[name].type
        calls = {
            "Real": "setReal",
            "Integer": "setInteger",
            "Boolean": "setBoolean",
            "Float64": "setFloat64",
            "Int32": "setInt32",
        }
        calls["Enumeration"] = "setInteger" if self.two else "setInt64"
        getattr(self.fmu, calls[kind])([self.reference(name)], [value])

    def get(self, name: str) -> float:
        kind = self.variables[name].type
        calls = {
            "Real": "getReal",
            "Integer": "getInteger",
            "Boolean": "getBoolean",
            "Float64": "getFloat64",
            "Int32": "getInt32",
        }
        calls["Enumeration"] = "getInteger" if self.two else "getInt64"
        return getattr(self.fmu, calls[kind])([self.reference(name)])[0]

    def slope(self, name: str, value: float) -> None:
        if self.two:
            self.fmu.setRealInputDerivatives([self.reference(name)], [1], [value])
        else:
            self.set(f"der({name})", value)

    def step(self, time: float, size: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=size)

    def save(self):
        return self.fmu.getFMUstate() if self.two else self.fmu.getFMUState()

    def restore(self, state) -> None:
        (self.fmu.setFMUstate if self.two else self.fmu.setFMUState)(state)

    def serialize(self, state) -> bytes:
        return (self.fmu.serializeFMUstate if self.two else self.fmu.serializeFMUState)(state)

    def deserialize(self, data: bytes):
        return (self.fmu.deSerializeFMUstate if self.two else self.fmu.deserializeFMUState)(data)

    def directional(self, unknowns: list[str], knowns: list[str], seed: list[float]) -> list[float]:
        u, k = [self.reference(n) for n in unknowns], [self.reference(n) for n in knowns]
        call = self.fmu.getDirectionalDerivative
        return list(call(u, k, seed))

    def everything(self) -> dict[str, float]:
        """Every variable, for comparisons of bits."""
        return {n: self.get(n) for n in self.variables if n != "time" and not n.startswith("der(")}

    def function(self, name: str):
        return getattr(self.fmu.dll, name)

    def pointer(self):
        return ctypes.c_void_p(self.fmu.component)
