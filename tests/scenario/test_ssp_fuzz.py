"""Random damage to the files of an SSP: it is read or refused, never anything else."""

import random

import pytest
from lxml import etree

from cosim.errors import InputError
from cosim.scenario import load_scenario
from tests.support.ssp import (
    EXPERIMENT,
    METRE,
    MILLIMETRE,
    archive,
    binding,
    component,
    connection,
    parameter,
    structure,
)

JUNK = ["", "abc", "1,5", "-1", "1e999", "nan", "9" * 50, "true", "a.b", "../x", "ä ∞", "%00", "http://[", "#"]
JUNK += ["x" * 5000, "file:///", "//x/y", ".", "resources"]


def whole_system() -> str:
    """A structure with something of each kind."""
    mapping = (
        '<ssd:ParameterMapping><ssm:ParameterMapping version="1.0"><ssm:MappingEntry source="q" target="k">'
        '<ssc:LinearTransformation factor="2"/></ssm:MappingEntry></ssm:ParameterMapping></ssd:ParameterMapping>'
    )
    values = parameter("q", 2.0, more='unit="mm"') + parameter("n", 3, "Integer")
    values += parameter("mode", "fast", "Enumeration")
    inner = (
        '<ssd:System name="s"><ssd:Connectors><ssd:Connector name="in" kind="input"><ssc:Real/></ssd:Connector>'
        f"</ssd:Connectors><ssd:Elements>{component('b')}</ssd:Elements><ssd:Connections>{connection('in', 'b.u')}"
        "</ssd:Connections></ssd:System>"
    )
    elements = component("a", binding(values, mapping=mapping, units=MILLIMETRE + METRE)) + inner
    after = f"<ssd:Units>{METRE}</ssd:Units>" + EXPERIMENT
    return structure(elements, connection("a.x", "s.in"), binding(parameter("b.k", 1.0), 'prefix="s."'), after)


def damage(text: str, chance: random.Random) -> str:
    """One to three random changes: an attribute or an element gone, doubled, renamed or filled with junk."""
    root = etree.fromstring(text.encode())
    for _ in range(chance.randint(1, 3)):
        element = chance.choice(list(root.iter()))
        parent, what = element.getparent(), chance.randrange(6)
        if what == 0 and parent is not None:
            parent.remove(element)
        elif what == 1 and parent is not None:
            parent.append(etree.fromstring(etree.tostring(element)))
        elif what == 2:
            other = chance.choice(list(root.iter()))
            element.tag = other.tag
        elif what == 3 and element.attrib:
            del element.attrib[chance.choice(list(element.attrib))]
        elif element.attrib:
            element.set(chance.choice(list(element.attrib)), chance.choice(JUNK).replace("\0", ""))
    return etree.tostring(root).decode()


@pytest.mark.parametrize("seed", range(6))
def test_damaged_structures_are_read_or_refused(tmp_path, seed):
    chance, read, refused = random.Random(seed), 0, 0
    for number in range(25):
        path = archive(tmp_path / f"{number}.ssp", damage(whole_system(), chance))
        try:
            load_scenario(path)
            read += 1
        except InputError:
            refused += 1
    assert read + refused == 25 and refused >= 10
