"""Probable format of a file, from its first bytes: only for explanations, never to read it."""

from pathlib import Path

from hri_predict.recording.bounded import names_in_zip
from hri_predict.recording.format_table import FORMATS

HEAD_BYTES = 4096
# First bytes, and what they begin, of kinds that are not read.
_OTHERS: tuple[tuple[bytes, str], ...] = (
    (b"\x89HDF\r\n\x1a\n", "HDF5, or MATLAB 7.3"),
    (b"MATLAB 5.0 MAT-file", "MATLAB"),
    (b"Kaydara FBX Binary", "FBX"),
    (b"; FBX", "FBX as text"),
    (b"glTF", "glTF, or VRM"),
    (b"LOGG", "Vector's BLF: bus traffic, not motion"),
    (b";$FILEVERSION", "PEAK's trace of a CAN bus: bus traffic, not motion"),
    (b"date ", "Vector's ASC: bus traffic, not motion"),
    (b":ASF", "Acclaim's skeleton (ASF)"),
    (b"# AST/ASF", "Acclaim's skeleton (ASF)"),
    (b"#!OML:ASF", "Acclaim's motion (AMC)"),
    (b":FULLY-SPECIFIED", "Acclaim's motion (AMC)"),
    (b"PAR1", "Parquet"),
    (b"ARROW1", "Arrow"),
    (b"PXR-USDC", "USD"),
    (b"\x1f\x8b", "gzip: unpack it"),
    (b"7z\xbc\xaf\x27\x1c", "7-Zip: unpack it"),
    (b"Rar!", "RAR: unpack it"),
    (b"BZh", "bzip2: unpack it"),
    (b"\xfd7zXZ", "xz: unpack it"),
    (b"\x28\xb5\x2f\xfd", "Zstandard: unpack it"),
    (b"\x89PNG", "an image (PNG)"),
    (b"\xff\xd8\xff", "an image (JPEG)"),
    (b"%PDF", "PDF"),
    (b"\x7fELF", "a program"),
    (b"version https://git-lfs", "a Git LFS pointer: fetch the file itself by git lfs pull"),
)


def seems(path: Path) -> tuple[str, str]:
    """Return the probable ending and content of a file by its first bytes.

    They are (".bvh", "BVH") or ("", "FBX"): the ending is "" for a kind that is not read, and both
    are "" for an unknown one.

    Raises:
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head[4:8] == b"ftyp":
        return "", "a film (MP4)"
    text = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    for magic, what in _OTHERS:
        if head.startswith(magic) or (magic.isascii() and text.startswith(magic)):
            return "", what
    for each in FORMATS:
        if each.looks(path, head):
            return each.ending, each.content
    if head[:1] == b"\x80" and head[1:2] in (b"\2", b"\3", b"\4", b"\5"):
        return ".pkl", "a Python pickle, of which only 3DPW's are read, as data"
    if head.startswith(b"PK\x03\x04"):
        return "", _zip(path)
    return "", "" if b"\0" in head else _text(text)


def _zip(path: Path) -> str:
    names = names_in_zip(path)
    if names is None:
        return "a damaged zip archive"
    if "[Content_Types].xml" in names:
        return "an Office document: save it as CSV"
    return "a zip archive: unpack it"


def _text(text: bytes) -> str:
    if text.startswith((b"{", b"[")):
        return "JSON"
    if text.startswith(b"<"):
        return "Xsens MVNX" if b"<mvnx" in text else "XML"
    return ""
