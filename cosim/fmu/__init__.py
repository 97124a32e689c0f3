"""FMUs from files, by fmpy: found or built, extracted once, described, loaded, and driven through preallocated arrays.

The only part of cosim that imports fmpy. One call sets the inputs of an instance and one gets its outputs.
"""

from cosim.fmu.description import describe, descriptions
from cosim.fmu.fmi2 import Fmi2Instance
from cosim.fmu.fmi3 import Fmi3Instance
from cosim.fmu.instance import FmuInstance
from cosim.fmu.places import extracted, fmu_file, read_columns
from cosim.fmu.system import FmuSet, load, open_system

__all__ = [
    "Fmi2Instance",
    "Fmi3Instance",
    "FmuInstance",
    "FmuSet",
    "describe",
    "descriptions",
    "extracted",
    "fmu_file",
    "load",
    "open_system",
    "read_columns",
]
