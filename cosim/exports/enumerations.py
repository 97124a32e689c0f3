"""FMUs with whole numbers in place of enumerations, for importers that know none (Maestro, libcosim's start values)."""

import zipfile
from pathlib import Path

from lxml import etree


def whole_numbers(fmu: Path) -> Path:
    """A copy of an FMU, kept in the cache, whose enumerations are declared as integers with the same values."""
    from build_fmus.archive import zip_bytes
    from build_fmus.cache import cache_folder, key_of, store

    target = cache_folder() / "whole_numbers" / key_of(fmu.read_bytes())[:24] / fmu.name
    if not target.is_file():
        with zipfile.ZipFile(fmu) as archive:
            files = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
        files["modelDescription.xml"] = _described(files["modelDescription.xml"])
        store(target, zip_bytes(files))
    return target


def _described(text: bytes) -> bytes:
    """The model description without enumerations."""
    root = etree.fromstring(text, etree.XMLParser(resolve_entities=False, no_network=True))
    version = root.get("fmiVersion", "")
    for variable in root.findall("ModelVariables//Enumeration"):
        variable.tag = "Integer" if version.startswith("2") else "Int64"
        for key in ("declaredType", "quantity"):
            if key in variable.attrib:
                del variable.attrib[key]
    definitions = root.find("TypeDefinitions")
    if definitions is not None:
        for declared in list(definitions):
            if declared.tag == "EnumerationType" or declared.find("Enumeration") is not None:
                definitions.remove(declared)
        if not len(definitions):
            root.remove(definitions)
    return etree.tostring(root, encoding="UTF-8", xml_declaration=True)
