"""Packages of third parties, as pip would install them."""

from pathlib import Path


def third_party(folder: Path, entry_points: str | bytes, **modules: str) -> Path:
    """Put a package ``theirs`` 1.0 with these modules (name -> source) into a folder.

    Returns:
        Its folder of metadata.
    """
    info = folder / "theirs-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    data = entry_points if isinstance(entry_points, bytes) else entry_points.encode()
    (info / "entry_points.txt").write_bytes(data)
    for name, source in modules.items():
        (folder / f"{name}.py").write_text(source, encoding="utf-8")
    return info
