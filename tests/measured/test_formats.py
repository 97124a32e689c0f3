"""One file of each format, by the format's own writer and with awkward features: the numbers are those of the CSV."""

import json

import numpy as np
import pytest

from cosim.errors import InputError
from cosim.measured import parse_description, read
from cosim.measured.reader import read_table

ROWS = 600
START = 1718000000123456789  # ns: 2024-06-10, with digits that a float does not hold
TIME = np.arange(ROWS) * 0.002
STAMPS = START + np.arange(ROWS) * 2_000_000
Q = np.stack([0.4 * np.sin(3 * TIME) + 0.1, 0.3 * np.cos(2 * TIME) - 1 / 3], axis=1)
TAU = np.stack([np.cos(4 * TIME), np.sin(5 * TIME) / 7], axis=1)


def axis(time="t", q="q", tau="tau", **more):
    return parse_description({"device": "axis", "columns": {"time": time, "q": q, "tau": tau}, **more}, "d")


@pytest.fixture(scope="session")
def csv_run(tmp_path_factory):
    """The same numbers from a plain CSV with all their digits."""
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    table = np.column_stack([TIME, Q[:, 0], TAU[:, 0]])
    np.savetxt(path, table, delimiter=",", header="t,q,tau", comments="", fmt="%.17g")
    return read([path], description=axis()).runs[0]


def same(path, csv_run, description):
    """Read a file; position, torque and step are those of the CSV to the last digit."""
    recording = read([path], description=description)
    run = recording.runs[0]
    assert np.array_equal(run.q, csv_run.q)
    assert np.array_equal(run.tau, csv_run.tau)
    assert np.array_equal(run.time, csv_run.time)
    return recording


def message(call) -> str:
    with pytest.raises(InputError) as caught:
        call()
    return str(caught.value)


def test_parquet_with_what_ros_and_lerobot_write(tmp_path, csv_run):
    import pyarrow as pa
    from pyarrow import parquet

    effort = [[None if value is None else value for value in row] for row in TAU.tolist()]
    table = pa.table(
        {
            "timestamp": pa.array(STAMPS, pa.timestamp("ns", "UTC")),
            "observation.state": pa.FixedSizeListArray.from_arrays(pa.array(Q.ravel()), 2),
            "joints": pa.array([{"effort": row, "mode": "on"} for row in effort]),
            "seq": pa.array(np.full(ROWS, 2**64 - 1, np.uint64)),
            "image": pa.array([b"\xff\xd8"] * ROWS),
            "tags": pa.array([["a"]] * ROWS),
        }
    )
    parquet.write_table(table, tmp_path / "a.parquet", row_group_size=100)
    recording = same(tmp_path / "a.parquet", csv_run, axis("timestamp", "observation.state[1]", "joints.effort[1]"))
    assert any("2024-06-10T06:13:20.123456789" in text for text in recording.warnings)
    text = message(lambda: read([tmp_path / "a.parquet"], description=axis("timestamp", "observation.state", "image")))
    assert "observation.state[1], observation.state[2]" in text and "image: binary holds no numbers" in text


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_stamps_of_each_resolution_in_parquet(tmp_path, unit):
    import pyarrow as pa
    from pyarrow import parquet

    count = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    stamps = 1718000000 * count + (np.arange(ROWS) * count if unit == "s" else np.arange(ROWS) * count // 500)
    table = pa.table({"t": pa.array(stamps, pa.timestamp(unit)), "n": pa.array(stamps), "q": Q[:, 0], "tau": TAU[:, 0]})
    parquet.write_table(table, tmp_path / "a.parquet")
    if unit == "s":
        assert "expected seconds" in message(lambda: read([tmp_path / "a.parquet"], description=axis("n")))
        return
    dates = read([tmp_path / "a.parquet"], description=axis("t")).runs[0]
    counted = read([tmp_path / "a.parquet"], description=axis("n", units={"time": unit})).runs[0]
    guessed = read([tmp_path / "a.parquet"], description=axis("n"))
    assert np.array_equal(dates.time, TIME) and np.array_equal(counted.time, TIME)
    assert np.array_equal(guessed.runs[0].time, TIME)
    assert any(f"read as {unit} since 1970" in text and "500 Hz" in text for text in guessed.warnings)


def test_nulls_are_missing_values_and_long_counters_keep_their_digits(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    q = [None if k == 300 else value for k, value in enumerate(Q[:, 0].tolist())]
    stamps = [None if k == 500 else value for k, value in enumerate(STAMPS.tolist())]
    table = pa.table({"t": pa.array(stamps, pa.int64()), "q": q, "tau": TAU[:, 0], "n": pa.nulls(ROWS)})
    parquet.write_table(table, tmp_path / "a.parquet")
    recording = read([tmp_path / "a.parquet"], description=axis(units={"time": "ns"}))
    text = "\n".join(recording.warnings)
    assert "missing values interpolated (q 1)" in text and "1 rows without a time dropped" in text
    table = read_table(tmp_path / "a.parquet")
    assert np.isnan(table.columns["t"][500]) and int(table.columns["t"][499]) == STAMPS[499]


@pytest.mark.filterwarnings("ignore:Feather V1:DeprecationWarning")
@pytest.mark.parametrize("version", [1, 2])
def test_feather(tmp_path, csv_run, version):
    import pyarrow as pa
    from pyarrow import feather

    table = pa.table({"t": TIME, "q": Q[:, 0], "tau": TAU[:, 0], "word": ["a"] * ROWS})
    feather.write_feather(table, tmp_path / "a.feather", version=version)
    same(tmp_path / "a.feather", csv_run, axis())
    (tmp_path / "a.csv").write_bytes((tmp_path / "a.feather").read_bytes())  # content before suffix
    same(tmp_path / "a.csv", csv_run, axis())


def test_hdf5_by_paths(tmp_path, csv_run):
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        robot = file.create_group("robot")
        robot.create_dataset("q", data=np.rad2deg(Q).T, compression="gzip")  # joints by rows
        robot["q"].attrs["units"] = "deg"
        file["clock/stamp"] = STAMPS
        table = np.zeros(ROWS, [("tau", float, 2), ("mode", "S4")])
        table["tau"] = TAU
        file["logger"] = table
        file["image"] = np.zeros((5, 40, 40))
        file["gain"] = 3.0
        file["sim/q"] = Q
    where = ("/clock/stamp", "/robot/q[1]", "/logger.tau[1]")
    recording = read([tmp_path / "a.h5"], description=axis(*where, units={"time": "ns"}))
    assert any("q[1] in deg, as the file says" in text for text in recording.warnings)
    assert np.allclose(recording.runs[0].q, csv_run.q, rtol=0, atol=1e-15)
    assert np.array_equal(recording.runs[0].tau, csv_run.tau)
    same(tmp_path / "a.h5", csv_run, axis("stamp", "sim/q[1]", "tau[1]", units={"time": "ns"}))
    text = message(lambda: read([tmp_path / "a.h5"], description=axis("stamp", "q[1]", "tau[1]")))
    assert "/robot/q[1], /sim/q[1]" in text


def test_npz_and_npy(tmp_path, csv_run):
    np.savez_compressed(
        tmp_path / "a.npz", **{"robot/q": Q, "robot/tau": TAU}, t=TIME, names=np.array(["a", {}], dtype=object), n=3
    )
    same(tmp_path / "a.npz", csv_run, axis("t", "robot/q[1]", "tau1"))
    assert "names: not readable" in message(lambda: read([tmp_path / "a.npz"], description=axis("time", "names")))
    table = np.zeros(ROWS, [("t", float), ("q", float), ("tau", "f8", (2,))])
    table["t"], table["q"], table["tau"] = TIME, Q[:, 0], TAU
    np.save(tmp_path / "b.npy", table)
    same(tmp_path / "b.npy", csv_run, axis("t", "q", "tau[1]"))


def savemat(path, variables):
    from scipy.io import savemat as save

    save(path, variables)
    return path


def test_mat_structs_cells_and_an_unrelated_longer_vector(tmp_path, csv_run):
    arm = {"t": TIME, "q": Q, "tau": TAU}
    other = {"t": TIME, "q": 2 * Q, "tau": 3 * TAU}
    words = np.array(["on"] * ROWS, dtype=object)
    path = savemat(tmp_path / "a.mat", {"ur_a": arm, "ur_b": other, "long": np.zeros(5000), "mode": words, "gain": 2.0})
    same(path, csv_run, axis("ur_a.t", "ur_a.q[1]", "ur_a.tau[1]"))
    text = message(lambda: read([path], description=axis("t", "q[1]", "tau1")))
    assert "ur_a.q[1], ur_b.q[1]" in text and "ur_a.t, ur_b.t" in text
    runs = np.empty(2, dtype=object)
    runs[:] = [arm, other]
    path = savemat(tmp_path / "b.mat", {"runs": runs})
    same(path, csv_run, axis("runs{1}.t", "runs{1}.q[1]", "runs{1}.tau[1]"))
    assert "runs{1}.q[1], runs{2}.q[1]" in message(lambda: read([path], description=axis("t", "q[1]", "tau1")))
    records = np.zeros(2, [("t", object), ("q", object), ("tau", object)])
    for k, item in enumerate((arm, other)):
        records[k] = (item["t"], item["q"], item["tau"])
    path = savemat(tmp_path / "c.mat", {"runs": records})
    same(path, csv_run, axis("runs(1).t", "runs(1).q[1]", "runs(1).tau[1]"))


def test_mat_4(tmp_path, csv_run):
    from scipy.io import savemat as save

    save(tmp_path / "a.mat", {"t": TIME, "q": Q[:, 0], "tau": TAU[:, 0]}, format="4")
    same(tmp_path / "a.mat", csv_run, axis())


def test_a_single_struct_needs_no_qualified_names(tmp_path, csv_run):
    path = savemat(tmp_path / "a.mat", {"data": {"t": TIME, "q": Q[:, 0], "tau": TAU[:, 0]}})
    same(path, csv_run, axis())


def mat_element(kind: int, data: bytes) -> bytes:
    """A data element of the MAT 5 format: type, size, data padded to 8 bytes (MAT-File Format, The MathWorks, 1-2)."""
    return np.array([kind, len(data)], "<u4").tobytes() + data + b"\0" * (-len(data) % 8)


def test_a_timetable_in_mat_is_named_with_the_way_out(tmp_path, csv_run):
    path = savemat(tmp_path / "a.mat", {"t": TIME, "q": Q[:, 0], "tau": TAU[:, 0]})
    flags = mat_element(6, np.array([17, 0], "<u4").tobytes())  # class 17: an object that only MATLAB opens
    numbers = mat_element(6, np.array([13, 0], "<u4").tobytes()) + mat_element(5, np.array([1, 1], "<i4").tobytes())
    inner = mat_element(14, numbers + mat_element(1, b"") + mat_element(6, np.array([1], "<u4").tobytes()))
    words = b"".join(mat_element(1, word) for word in (b"tt", b"MCOS", b"timetable"))
    path.write_bytes(path.read_bytes() + mat_element(14, flags + words + inner))
    same(path, csv_run, axis())  # unused, it condemns nothing
    text = message(lambda: read([path], description=axis(q="position")))
    assert "tt: a timetable" in text and "writetimetable" in text


def mat73(path, fill):
    """MAT 7.3: HDF5 behind MATLAB's text of 512 bytes; `fill` writes the variables with MATLAB's attributes."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        fill(file)
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"
    with path.open("r+b") as file:
        file.write(text.ljust(512, b"\0"))
    return path


def put(group, name, array, kind="double"):
    """An array as MATLAB writes it: at least two dimensions, columns first, its class as an attribute."""
    data = group.create_dataset(
        name, data=np.atleast_2d(array).T if np.ndim(array) != 1 else np.asarray(array)[None, :]
    )
    data.attrs["MATLAB_class"] = np.bytes_(kind)
    return data


def test_mat_73(tmp_path, csv_run):
    import h5py

    def struct(file, name, q, tau):
        group = file.create_group(name)
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        put(group, "t", TIME)
        put(group, "q", q)
        put(group, "tau", tau)
        return group

    def fill(file):
        struct(file, "ur_a", Q, TAU)
        struct(file, "ur_b", 2 * Q, 3 * TAU)
        put(file, "note", np.array([[ord(c) for c in "hello"]], np.uint16), "char")
        empty = put(file, "nothing", np.zeros(2, np.uint64))
        empty.attrs["MATLAB_empty"] = 1
        table = put(file, "tt", np.zeros(6, np.uint32), "timetable")
        table.attrs["MATLAB_object_decode"] = np.int32(3)
        refs = file.create_group("#refs#")
        inner = struct(refs, "a", Q, TAU)
        cell = file.create_dataset("runs", (1, 1), dtype=h5py.ref_dtype)
        cell[0, 0] = inner.ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        rows = file.create_group("rec")
        rows.attrs["MATLAB_class"] = np.bytes_("struct")
        for field in ("t", "q", "tau"):
            links = rows.create_dataset(field, (2, 1), dtype=h5py.ref_dtype)
            for k in range(2):
                links[k, 0] = (inner if k == 0 else file["ur_b"])[field].ref

    path = mat73(tmp_path / "a.mat", fill)
    same(path, csv_run, axis("ur_a.t", "ur_a.q[1]", "ur_a.tau[1]"))
    same(path, csv_run, axis("runs{1}.t", "runs{1}.q[1]", "runs{1}.tau[1]"))
    same(path, csv_run, axis("rec(1).t", "rec(1).q[1]", "rec(1).tau[1]"))
    text = message(lambda: read([path], description=axis("ur_a.t", "q[1]", "torque")))
    assert "ur_a.q[1], ur_b.q[1]" in text and "tt: a timetable" in text and "writetimetable" in text


def joint_state(store, stamp, names, position, effort, ros1=False):
    kinds = store.types
    time = kinds["builtin_interfaces/msg/Time"](sec=int(stamp // 10**9), nanosec=int(stamp % 10**9))
    sequence = {"seq": 0} if ros1 else {}
    header = kinds["std_msgs/msg/Header"](**sequence, stamp=time, frame_id="base")
    return kinds["sensor_msgs/msg/JointState"](
        header=header, name=list(names), position=np.array(position), velocity=np.array([]), effort=np.array(effort)
    )


@pytest.fixture(params=["ros1", "sqlite3", "mcap"])
def bag(request, tmp_path):
    """/joint_states with header stamps and late receipt, /torque at twice the rate without a header."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    ros1 = request.param == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    path = tmp_path / ("a.bag" if ros1 else "bag")
    plugin = StoragePlugin.MCAP if request.param == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
    pack = store.serialize_ros1 if ros1 else store.serialize_cdr
    kinds = store.types
    with writer as open_writer:
        states = open_writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        torque = open_writer.add_connection("/torque", "std_msgs/msg/Float64MultiArray", typestore=store)
        for k, stamp in enumerate(STAMPS.tolist()):
            state = joint_state(store, stamp, ["shoulder", "elbow"], Q[k], TAU[k], ros1)
            open_writer.write(states, stamp + 300_000, pack(state, states.msgtype))
            for half in (0, 1_000_000):
                layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
                value = np.array([TAU[k, 0] + (0.001 if half else 0.0)])
                many = kinds["std_msgs/msg/Float64MultiArray"](layout=layout, data=value)
                open_writer.write(torque, stamp + half, pack(many, torque.msgtype))
    return path


def test_bags(bag, csv_run):
    paths = [bag, *bag.glob("*.db3"), *bag.glob("*.mcap")] if bag.is_dir() else [bag]
    for path in paths:
        where = ("/joint_states.stamp", "/joint_states.position[1]")
        same(path, csv_run, axis(*where, "/joint_states.effort[1]"))
        same(path, csv_run, axis("time", "position[shoulder]", "effort[shoulder]"))
        same(path, csv_run, axis("/joint_states.received", "position[1]", "effort[1]"))
        aligned = same(path, csv_run, axis(*where, "/torque.data[1]"))
        text = "\n".join(aligned.warnings)
        assert "from 1000 Hz to 500 Hz by linear interpolation" in text
        assert "/joint_states.position[1]" in message(lambda path=path: read([path], description=axis(*where, "tau")))


def test_messages_about_different_joints_on_one_topic(tmp_path, csv_run):
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(tmp_path / "bag", version=9) as writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for k, stamp in enumerate(STAMPS.tolist()):
            arm = joint_state(store, stamp, ["shoulder", "elbow"], Q[k], TAU[k])
            hand = joint_state(store, stamp + 700_000, ["finger"], [9.0 + k], [1.0])
            writer.write(states, stamp, store.serialize_cdr(arm, states.msgtype))
            writer.write(states, stamp + 700_000, store.serialize_cdr(hand, states.msgtype))
    same(tmp_path / "bag", csv_run, axis("time", "position[shoulder]", "effort[shoulder]"))
    text = message(lambda: read([tmp_path / "bag"], description=axis("time", "position[1]", "effort[1]")))
    assert "finger; shoulder, elbow" in text and "/joint_states.position[1][finger]" not in text


def test_mcap_with_json(tmp_path, csv_run):
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(name="state", encoding="jsonschema", data=b"{}")
        channel = writer.register_channel(schema_id=schema, topic="/arm", message_encoding="json")
        other = writer.register_channel(schema_id=schema, topic="/camera", message_encoding="protobuf")
        for k, stamp in enumerate(STAMPS.tolist()):
            content = {"stamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9}, "q": Q[k].tolist(), "tau": TAU[k, 0]}
            writer.add_message(channel, stamp + 5000, json.dumps(content).encode(), stamp + 5000)
            writer.add_message(other, stamp, b"\x01", stamp)
        writer.finish()
    same(tmp_path / "a.mcap", csv_run, axis("/arm.stamp", "/arm.q[1]", "/arm.tau"))
    assert "/camera: messages in protobuf" in message(lambda: read([tmp_path / "a.mcap"], description=axis(q="image")))


def test_mdf(tmp_path, csv_run):
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(Q[:, 0], TIME, name="q", unit="rad"), Signal(TAU[:, 0], TIME, name="tau", unit="Nm")])
        fast = np.arange(2 * ROWS) * 0.001
        slow = np.interp(fast, TIME, TAU[:, 0])
        file.append([Signal(slow, fast, name="tau_fast", unit="Nm")])
        file.append([Signal(2 * Q[:, 0], TIME, name="q2", unit="deg")])
        file.save(tmp_path / "a.mf4")
    same(tmp_path / "a.mf4", csv_run, axis("time (group 1)", "q", "tau"))
    aligned = same(tmp_path / "a.mf4", csv_run, axis("time (group 1)", "q", "tau_fast"))
    assert any("1000 Hz to 500 Hz" in text for text in aligned.warnings)
    same(tmp_path / "a.mf4", csv_run, axis("time", "q", "tau"))  # the one of q's group
    converted = read([tmp_path / "a.mf4"], description=axis("time", "q2", "tau"))
    assert np.allclose(converted.runs[0].q, np.deg2rad(2 * csv_run.q), rtol=1e-15)


@pytest.mark.parametrize(
    ("package", "magic", "name"), [("asammdf", b"MDF     4.10", "mdf"), ("rosbags", b"#ROSBAG V2.0\n", "ros")]
)
def test_a_missing_package_is_named_with_its_command(tmp_path, monkeypatch, package, magic, name):
    import sys

    for loaded in [key for key in sys.modules if key.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "a.bin").write_bytes(magic + b"\0" * 200)
    assert f"pip install 'haptic-cosim[{name}]'" in message(lambda: read_table(tmp_path / "a.bin"))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"\x1f\x8b\x08\0\0", "gunzip"),
        ("a.csv", b"PK\x03\x04 broken", "damaged ZIP"),
        ("a.csv", b"\xd0\xcf\x11\xe0\xa1\xb1", "save it as CSV"),
        ("a.csv", b"t,q\0,tau\n" * 9, "binary content"),
        ("a.h5", b"hello", "expected an HDF5 file"),
        ("a.mcap", b"\x89MCAP0\r\n1234", "MCAP"),
        ("a.h5", b"\x89HDF\r\n\x1a\n1234", "HDF5"),
        ("a.npz", b"\x93NUMPYxx", "NPY"),
        ("a.mf4", b"MDF     4.10".ljust(2000, b"\0"), "MDF"),
        ("a.db3", b"SQLite format 3\0\0\0", "ROS bag"),
        ("a.parquet", b"PAR1\0\0\0\0PAR1", "Parquet"),
        ("a.feather", b"ARROW1\0\0", "Feather"),
        ("a.mat", b"MATLAB 5.0 MAT-file, Platform", "MAT"),
    ],
)
def test_what_is_damaged_or_another_thing_is_named(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    assert words in message(lambda: read_table(tmp_path / name))
