"""Names of a model's parameters: a parameter of the whole device, of one of its joints, or one element of a list."""

from attrs import frozen


@frozen
class Label:
    """The name of a parameter and, where there are several, the number of this one, counted from 1.

    `str(Label("stribeck", 2))` is "stribeck[2]", which is also the name of the FMU's variable; `str(Label("payload"))`
    is "payload".
    """

    name: str
    index: int | None = None

    def __str__(self) -> str:
        return self.name if self.index is None else f"{self.name}[{self.index}]"

    @classmethod
    def of_joint(cls, name: str, joint: int) -> "Label":
        """The parameter of one joint, counted from 0."""
        return cls(name, joint + 1)

    @classmethod
    def read(cls, text: str) -> "Label":
        """The label that a text such as "stribeck[2]" spells: for names that a user's own file gives as text."""
        name, bracket, rest = text.partition("[")
        number = rest.removesuffix("]")
        if bracket and number != rest and number.isdecimal() and name.isidentifier():
            return cls(name, int(number))
        return cls(text)
