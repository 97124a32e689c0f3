"""What a file is, told by its first bytes; the suffix decides only what the bytes leave open."""

from pathlib import Path

from attrs import frozen

from cosim.errors import InputError, Problem
from cosim.opening import named_file

TEXT, PARQUET, ARROW, MATLAB, HDF5, NPZ = "text table", "Parquet", "Feather", "MAT", "HDF5", "NPZ"
ROSBAG, MCAP, MDF = "ROS bag", "MCAP", "MDF"
SUFFIXES = {
    TEXT: (".csv", ".tsv", ".txt"),
    PARQUET: (".parquet",),
    ARROW: (".feather", ".arrow"),
    MATLAB: (".mat",),
    HDF5: (".h5", ".hdf5"),
    NPZ: (".npz", ".npy"),
    ROSBAG: (".bag", ".db3"),
    MCAP: (".mcap",),
    MDF: (".mf4", ".mdf"),
}
MAGIC = (
    (b"PAR1", PARQUET),
    (b"ARROW1", ARROW),
    (b"FEA1", ARROW),
    (b"MATLAB 5.0 MAT-file", MATLAB),
    (b"MATLAB 7.3 MAT-file", MATLAB),
    (b"\x89HDF\r\n\x1a\n", HDF5),
    (b"\x93NUMPY", NPZ),
    (b"#ROSBAG V", ROSBAG),
    (b"SQLite format 3\x00", ROSBAG),
    (b"\x89MCAP", MCAP),
    (b"MDF     ", MDF),
)


@frozen
class _Stranger:
    """Content that is recognised and not read: what it is and what to do."""

    magic: bytes
    name: str
    advice: str


STRANGERS = (
    _Stranger(b"\x1f\x8b", "a gzip archive", "unpack it first: gunzip"),
    _Stranger(b"BZh", "a bzip2 archive", "unpack it first: bunzip2"),
    _Stranger(b"\xfd7zXZ", "an xz archive", "unpack it first: unxz"),
    _Stranger(b"\x28\xb5\x2f\xfd", "a Zstandard archive", "unpack it first: zstd -d"),
    _Stranger(b"7z\xbc\xaf", "a 7z archive", "unpack it first"),
    _Stranger(b"\xd0\xcf\x11\xe0", "an old Excel workbook", "save it as CSV UTF-8"),
    _Stranger(b"%PDF", "a PDF document", "give the recording itself"),
    _Stranger(b"TDSm", "a LabVIEW TDMS file", "export it as CSV, or as MDF or HDF5"),
)


def kind_of(path: Path) -> str:
    """The kind of a file, one of the keys of SUFFIXES. Raises InputError for what cannot be read."""
    if path.is_dir():
        return _folder(path)
    with named_file(path, "a recording").open("rb") as file:
        head = file.read(1024)
    if not head:
        raise InputError(Problem(str(path), "data", "an empty file"))
    return _by_content(path, head) or _by_suffix(path)


def _folder(path: Path) -> str:
    if (path / "metadata.yaml").is_file():
        return ROSBAG
    raise InputError(Problem(str(path), "a file, or the folder of a ROS 2 bag", "a folder without metadata.yaml"))


def _by_content(path: Path, head: bytes) -> str:
    """The kind that the first bytes tell, or nothing."""
    for stranger in STRANGERS:
        if head.startswith(stranger.magic):
            raise InputError(Problem(str(path), "a recording", stranger.name, stranger.advice))
    if head.startswith(b"PK\x03\x04"):
        return _zip(path)
    found = next((kind for magic, kind in MAGIC if head.startswith(magic)), "")
    return MATLAB if found == HDF5 and path.suffix.lower() == ".mat" else found


def article(kind: str) -> str:
    """`a Parquet`, `an HDF5`."""
    return f"{'an' if kind[0] in 'AEIO' or kind[:2] in ('HD', 'NP', 'MC', 'MD') else 'a'} {kind}"


def _zip(path: Path) -> str:
    """NPZ files and office documents are ZIP archives; what is inside tells them apart."""
    from zipfile import BadZipFile, ZipFile

    try:
        names = ZipFile(path).namelist()
    except BadZipFile as error:
        raise InputError(Problem(str(path), "a whole file", f"a damaged ZIP archive: {error}")) from None
    if names and all(name.endswith(".npy") for name in names):
        return NPZ
    if any(name.startswith("xl/") for name in names) or "mimetype" in names:
        raise InputError(Problem(str(path), "a recording", "a spreadsheet", "save it as CSV UTF-8"))
    inside = ", ".join(names[:4])
    raise InputError(Problem(str(path), "a recording", f"a ZIP archive ({inside})", "unpack it first"))


def _by_suffix(path: Path) -> str:
    """Bytes without a mark: MAT files up to version 4 and text have none."""
    suffix = path.suffix.lower()
    if suffix == ".mat":
        return MATLAB
    marked = {s: kind for kind, suffixes in SUFFIXES.items() for s in suffixes if kind != TEXT}
    if suffix in marked:
        advice = "is it damaged, or a text table? (then name it .csv)"
        raise InputError(Problem(str(path), f"{article(marked[suffix])} file", "content of another kind", advice))
    if suffix in (".xlsx", ".xls", ".ods", ".xlsm"):
        known = ", ".join(s for suffixes in SUFFIXES.values() for s in suffixes)
        raise InputError(Problem(str(path), f"a file of {known}", repr(path.suffix), "save it as CSV UTF-8"))
    return TEXT
