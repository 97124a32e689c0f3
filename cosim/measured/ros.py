"""ROS 1 bags, ROS 2 bags and MCAP files to columns: `/joint_states.position[1]`, each topic with its own stamps.

A topic has the columns `TOPIC.stamp` (its header's, where it has one) and `TOPIC.received`, whole nanoseconds.
"""

import itertools
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from cosim.errors import InputError, Problem
from cosim.measured.content import MCAP, article
from cosim.measured.table import WIDEST, LazyColumns, RawTable, short_names

Row = dict[str, Any]  # a message, flat
Readers = dict[str, Callable[[], np.ndarray]]
BEGINNING = 50  # messages that show what a topic holds
INSTALL = "pip install 'haptic-cosim[ros]'"


def read_ros(path: Path, kind: str) -> RawTable:
    """A bag or an MCAP file. Raises InputError; a topic that is not used is not decoded beyond its first messages."""
    try:
        source = _Mcap(path) if kind == MCAP else _Bag(path)
        topics = source.topics()
    except ImportError as error:
        raise InputError(
            Problem(str(path), f"a package that reads {article(kind)} file", f"no {error.name}", INSTALL)
        ) from None
    except Exception as error:  # noqa: BLE001 - the readers of bags raise many kinds for damaged files
        raise InputError(_unreadable(path, kind, error)) from None
    return _table(path, source, topics)


def _unreadable(path: Path, kind: str, error: Exception) -> Problem:
    got = f"{type(error).__name__}: {(str(error).splitlines() or [''])[0][:200]}"
    advice = (
        "ROS 1 bags are named .bag, ROS 2 bags .db3 or .mcap or are folders with metadata.yaml; "
        "rosbag reindex, ros2 bag reindex or mcap recover mends one that was cut off"
    )
    return Problem(str(path), f"{article(kind)} file", got, advice)


class _Source(ABC):
    """Topics of a file and their decoded messages."""

    @abstractmethod
    def topics(self) -> dict[str, str]:
        """Topics -> "", or why their messages cannot be decoded."""

    @abstractmethod
    def messages(self, topic: str) -> Iterator[tuple[int, object]]:
        """Time of receipt [ns] and message, in order."""


class _Bag(_Source):
    """ROS 1 and ROS 2 bags by rosbags."""

    def __init__(self, path: Path) -> None:
        import rosbags.highlevel  # noqa: F401 - a missing package is told before anything else

        self._path = path

    def _open(self):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        return AnyReader([self._path], default_typestore=get_typestore(Stores.LATEST))

    def topics(self) -> dict[str, str]:
        with self._open() as reader:
            return {connection.topic: "" for connection in reader.connections if connection.msgcount}

    def messages(self, topic: str) -> Iterator[tuple[int, object]]:
        with self._open() as reader:
            wanted = [connection for connection in reader.connections if connection.topic == topic]
            for connection, received, data in reader.messages(connections=wanted):
                yield received, reader.deserialize(data, connection.msgtype)


class _Mcap(_Source):
    """MCAP files by mcap; ROS messages decoded by rosbags, JSON by Python."""

    def __init__(self, path: Path) -> None:
        import mcap.reader  # noqa: F401 - a missing package is told before anything else

        self._path = path
        self._decoders: dict[int, Callable[[bytes], object]] = {}

    def topics(self) -> dict[str, str]:
        from mcap.reader import make_reader

        with self._path.open("rb") as file:
            summary = make_reader(file).get_summary()
            if summary is None or not summary.channels:
                raise ValueError("no list of channels at its end")
            return {c.topic: _undecoded(c.message_encoding) for c in summary.channels.values()}

    def messages(self, topic: str) -> Iterator[tuple[int, object]]:
        from mcap.reader import make_reader

        with self._path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages(topics=[topic]):
                if channel.id not in self._decoders:
                    self._decoders[channel.id] = _decoder(schema, channel.message_encoding)
                yield message.log_time, self._decoders[channel.id](message.data)


def _undecoded(encoding: str) -> str:
    return (
        ""
        if encoding in ("cdr", "ros1", "json")
        else f"messages in {encoding or 'an unnamed encoding'}: convert to ROS or JSON"
    )


def _decoder(schema, encoding: str) -> Callable[[bytes], object]:
    if encoding == "json":
        return json.loads
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    text = schema.data.decode("utf-8")
    idl = schema.encoding == "ros2idl"
    store.register(get_types_from_idl(text) if idl else get_types_from_msg(text, schema.name))
    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
    if encoding == "ros1":
        return lambda data: store.deserialize_ros1(data, name)
    return lambda data: store.deserialize_cdr(data, name)


@frozen(eq=False)
class _Topic:
    """One topic: its first messages flattened, and all its rows where they are asked for."""

    path: Path
    source: _Source
    name: str
    beginning: tuple[Row, ...]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names that stand beside the values (JointState), of all the first messages."""
        return tuple(dict.fromkeys(name for row in self.beginning for name in _words(row)))

    @property
    def mixed(self) -> bool:
        """Whether messages about different joints share the topic."""
        return len({_words(row) for row in self.beginning if _words(row)}) > 1


def _table(path: Path, source: _Source, topics: dict[str, str]) -> RawTable:
    readers: Readers = {}
    clocks: dict[str, str] = {}
    unread = {topic: why for topic, why in topics.items() if why}
    for topic in sorted(set(topics) - set(unread)):
        try:
            first = tuple(_row(*item) for item in itertools.islice(source.messages(topic), BEGINNING))
        except Exception as error:  # noqa: BLE001 - a topic that cannot be decoded is told where it is asked for
            unread[topic] = f"its messages cannot be decoded ({str(error)[:80]})"
            continue
        if first:
            _topic_columns(_Topic(path, source, topic, first), readers, clocks)
    units = {name: "ns" for name in readers if name.endswith((".stamp", ".received")) or ".stamp[" in name}
    return RawTable(path, LazyColumns(readers), units=units, short=short_names(readers), clocks=clocks, unread=unread)


def _topic_columns(topic: _Topic, readers: Readers, clocks: dict[str, str]) -> None:
    """Columns of a topic: scalars, elements of vectors, and values by the name of their joint."""

    @cache
    def rows() -> list[Row]:
        return _all_rows(topic)

    clock = f"{topic.name}.stamp"
    for key in dict.fromkeys(key for row in topic.beginning for key in row):
        width = max(_width(row[key]) for row in topic.beginning if key in row)
        if width == 0:
            readers[f"{topic.name}.{key}"] = lambda key=key: _scalars(rows(), key)
            clocks[f"{topic.name}.{key}"] = clock
        elif 0 < width <= WIDEST:
            for k in range(width):
                name = f"{topic.name}.{key}[{k + 1}]"
                readers[name] = lambda key=key, k=k: _elements(topic, rows(), key, k)
                clocks[name] = clock
        if width > 0 and key != "name":
            _by_joint(topic, key, rows, readers, clocks)


def _by_joint(topic: _Topic, key: str, rows, readers: Readers, clocks: dict[str, str]) -> None:
    """`/joint_states.position[elbow]`; where messages about different joints share a topic, with their own stamps."""
    for joint in topic.joint_names:
        name = f"{topic.name}.{key}[{joint}]"
        clock = f"{topic.name}.stamp[{joint}]" if topic.mixed else f"{topic.name}.stamp"
        readers[name] = lambda joint=joint: _of_joint(rows(), key, joint)
        clocks[name] = clock
        if topic.mixed:
            readers[clock] = lambda joint=joint: _scalars([r for r in rows() if joint in _words(r)], "stamp")
            clocks[clock] = clock


def _all_rows(topic: _Topic) -> list[Row]:
    try:
        return [_row(*item) for item in topic.source.messages(topic.name)]
    except Exception as error:  # noqa: BLE001 - decoders raise many kinds
        got = f"{type(error).__name__}: {str(error)[:200]}"
        raise InputError(Problem(f"{topic.path}: {topic.name}", "messages that can be decoded", got)) from None


def _row(received: int, message) -> Row:
    """A message as flat values; the stamp is the header's, that of receipt where it has none."""
    row = dict(_flat("", message))
    stamp = row.get("header.stamp", row.get("stamp", 0))
    stamp = stamp if isinstance(stamp, int) and stamp > 0 else received
    return {"stamp": stamp, "received": received} | {key: value for key, value in row.items() if key != "stamp"}


def _flat(name: str, value) -> Iterator[tuple[str, object]]:
    """Fields of a message: numbers, words, vectors of either; times as whole nanoseconds."""
    fields = value if isinstance(value, dict) else getattr(value, "__dataclass_fields__", None)
    if fields is None:
        if isinstance(value, bool | int | float | str | np.number | np.ndarray) or _is_plain_list(value):
            yield name, value
        return
    inner = {
        key: value[key] if isinstance(value, dict) else getattr(value, key) for key in fields if key != "__msgtype__"
    }
    seconds, rest = inner.get("sec", inner.get("secs")), inner.get("nanosec", inner.get("nsec", inner.get("nsecs")))
    if len(inner) == 2 and isinstance(seconds, int) and isinstance(rest, int):
        yield name, seconds * 10**9 + rest
        return
    for key, item in inner.items():
        yield from _flat(f"{name}.{key}" if name else key, item)


def _is_plain_list(value) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(item, int | float | str) for item in value)


def _is_words(value) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(item, str) for item in value)


def _words(row: Row) -> tuple[str, ...]:
    names: Any = row.get("name")
    return tuple(names) if _is_words(names) else ()


def _width(value) -> int:
    """Elements of a vector, 0 for a scalar, -1 for what holds no column."""
    if isinstance(value, np.ndarray):
        return value.size if value.dtype.kind in "fiub" and value.size else -1
    if isinstance(value, list | tuple):
        return -1 if _is_words(value) or not value else len(value)
    return 0


def _scalars(rows: list[Row], key: str) -> np.ndarray:
    values = [row.get(key) for row in rows]
    if all(isinstance(value, int) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=np.int64)
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else str(value) for value in values])
    return np.array([np.nan if value is None else float(value) for value in values])


def _elements(topic: _Topic, rows: list[Row], key: str, k: int) -> np.ndarray:
    """Element k of a vector; NaN in messages that have fewer. The order of the joints must not change."""
    lists = {_words(row) for row in rows if _words(row)}
    if len(lists) > 1:
        texts = "; ".join(", ".join(names) for names in sorted(lists)[:3])
        advice = f"name the joint: {topic.name}.{key}[{min(lists)[0]}]"
        where = f"{topic.path}: {topic.name}.{key}[{k + 1}]"
        raise InputError(Problem(where, "the same joints in every message", f"{len(lists)} lists: {texts}", advice))
    return np.array([float(row[key][k]) if key in row and len(row[key]) > k else np.nan for row in rows])


def _of_joint(rows: list[Row], key: str, joint: str) -> np.ndarray:
    found = []
    for row in rows:
        names = _words(row)
        if joint in names:
            place, values = names.index(joint), row.get(key, ())
            found.append(float(values[place]) if len(values) > place else np.nan)
    return np.array(found)
