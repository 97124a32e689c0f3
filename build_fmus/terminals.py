"""terminalsAndIcons.xml, the icon, and buildDescription.xml of FMI 3."""

import struct
import zlib

from build_fmus.description import document, element
from build_fmus.table import ModelTable, ModelVariable


def terminals(table: ModelTable) -> str:
    """One terminal for each input or output array: its scalars belong together."""
    rows = [v for v in table.variable if v.causality in ("input", "output") and v.width > 1]
    children = [
        element(
            "GraphicalRepresentation",
            {},
            [
                element(
                    "CoordinateSystem",
                    {"x1": -100, "y1": -100, "x2": 100, "y2": 100, "suggestedScalingFactorTo_mm": 0.1},
                ),
                element("Icon", {"x1": -100, "y1": -100, "x2": 100, "y2": 100}),
            ],
        )
    ]
    if rows:
        children.append(element("Terminals", {}, [_terminal(v) for v in rows]))
    return document(element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"}, children))


def _terminal(v: ModelVariable) -> str:
    members = [
        element("TerminalMemberVariable", {"variableName": name, "memberName": str(i + 1), "variableKind": "signal"})
        for i, name in enumerate(v.fmi_names)
    ]
    return element("Terminal", {"name": v.name, "matchingRule": "plug", "description": v.description}, members)


def build_description(model: str) -> str:
    """How an importer compiles the sources: one file."""
    files = element(
        "SourceFileSet",
        {"language": "C99"},
        [
            element("SourceFile", {"name": "fmi3.c"}),
            element("IncludeDirectory", {"name": "."}),
        ],
    )
    configuration = element("BuildConfiguration", {"modelIdentifier": model}, [files])
    return document(element("fmiBuildDescription", {"fmiVersion": "3.0"}, [configuration]))


def icon_svg(table: ModelTable) -> str:
    """The icon of a model: its name in a box, with its inputs and outputs."""
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 200">'
        '<rect x="4" y="4" width="192" height="192" rx="12" fill="#fff" stroke="#334" stroke-width="8"/>'
        f'<text x="100" y="110" font-family="sans-serif" font-size="22" text-anchor="middle">{table.model.name}</text>'
        "</svg>\n"
    )


def icon_png(size: int = 64) -> bytes:
    """A framed white square, 8 bit grey; the name is in the SVG."""
    edge, side = bytes(size), bytes(2) + b"\xff" * (size - 4) + bytes(2)
    rows = [edge if y in (0, 1, size - 2, size - 1) else side for y in range(size)]
    image = zlib.compress(b"".join(b"\0" + row for row in rows), 9)
    head = struct.pack(">IIBBBBB", size, size, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", head) + _chunk(b"IDAT", image) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
