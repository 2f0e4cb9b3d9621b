"""Identity of a validated cell (configuration, files, versions), and the differences from it now.

The parsed configuration is compared, with all defaults, so comments, the order of keys and the
notation of values make no difference. The section ``commissioning`` is left out because it names
the report.
"""

import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from pydantic import JsonValue

from hri_predict import __version__
from hri_predict.base.errors import ConfigError, HriPredictError
from hri_predict.base.files import data_path
from hri_predict.base.machine.compiled import why_not_compiled
from hri_predict.base.settings import Settings
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import map_names
from hri_predict.contracts.source import SourceSettings
from hri_predict.operation.evidence.chain import file_hash
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.robots.file import robot_path
from hri_predict.robots.trajectory import trajectory_path
from hri_predict.run.config import Config
from hri_predict.zones.calibration import shipped_calibration

# -- the files that a configuration depends on: what is in them counts as much as its own keys -----

WRITTEN = ("record.file", "record.folder", "state.path", "evidence.folder")
"""Keys of files that the node writes: their content changes all the time."""
SECRET = "key_file"
"""A short secret can be guessed from its hash, so reports do not include the content of a key."""
SENSORS = "sensors"
"""Key of a source for the sources that it combines."""
ALERTS = "alerts."
"""Alert receivers do not affect advice, and these files are outputs or secrets."""


def escaped(name: str) -> str:
    """Return a name as one part of a dotted key."""
    return name.replace("\\", "\\\\").replace(".", "\\.")


def dependencies(config: Config, flat: Mapping[str, Any]) -> dict[str, Path]:
    """Return key of the configuration -> file that the key names or implies; it may be missing.

    Args:
        config: the configuration.
        flat: the configuration by dotted keys; see ``identity.flattened``.
    """
    found = dict(_known(config))
    for key, text in texts_of(flat):
        if key in found or key in WRITTEN or key.startswith(ALERTS):
            continue
        if key.rpartition(".")[2] == SECRET:
            continue
        path = _named(text, config.base_dir)
        if path is not None:
            found[key] = path
    return found


def texts_of(flat: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the texts of a flat configuration, also those in lists, each with its dotted key."""
    for key, value in flat.items():
        if isinstance(value, str):
            yield key, value
        elif isinstance(value, list):
            yield from texts_of({f"{key}.{i}": each for i, each in enumerate(value)})


def _found(
    find: Callable[[str, Path | None], Path], name: str, config: Config, *keys: str | int
) -> Path:
    """Return the file of a shipped name or a path; an error names the key and its line."""
    try:
        return find(name, config.base_dir)
    except HriPredictError as error:
        raise ConfigError(f"{config.place(*keys)}: {error}") from error


def _known(config: Config) -> Iterator[tuple[str, Path]]:
    """Return the files that are not found by a path relative to the configuration."""
    base_dir = config.base_dir
    for i, robot in enumerate(config.node.robots):
        model = _found(robot_path, robot.model, config, "robots", i, "model")
        yield f"robots.{escaped(robot.name)}.model", model
        for key in ("plan", "file"):
            name = getattr(robot.motion, key, None)
            if name is not None:
                path = _found(trajectory_path, name, config, "robots", i, "motion", key)
                yield f"robots.{escaped(robot.name)}.motion.{key}", path
    for i, link in enumerate(config.links):
        name = (link.simulate or {}).get("trajectory")
        if isinstance(name, str):
            path = _found(trajectory_path, name, config, "links", i, "simulate", "trajectory")
            yield f"links.{escaped(link.name)}.simulate.trajectory", path
    for i, path in enumerate(config.predictor.resolved(base_dir).files()):
        yield f"predictor.weights{f'.{i}' if i else ''}", path
    if config.node.risk.uses_forecasts:
        own = config.node.risk.coverage.calibration
        shipped = shipped_calibration(config.predictor.name)
        if own is not None:
            yield "risk.coverage.calibration", base_dir / own
        elif shipped.is_file():
            yield "risk.coverage.calibration", shipped
    for key, source in _sources(config.source).items():
        joint_map = getattr(source, "joint_map", None)
        if isinstance(joint_map, str) and joint_map in map_names():
            yield f"{key}.joint_map", data_path("skeletons", f"{joint_map}.yaml")


def _sources(source: SourceSettings) -> dict[str, SourceSettings]:
    """Return dotted key -> the source, and each source that it combines."""
    parts = {f"{SENSORS}.{escaped(name)}": part for name, part in source.parts.items()}
    return {"source": source} | {f"source.{key}": part for key, part in parts.items()}


def _named(text: str, base_dir: Path) -> Path | None:
    """Return the file named by a text, relative to the configuration."""
    if not text or "\0" in text:
        return None
    path = base_dir / text
    return path if os.path.isfile(path) else None  # does not raise if the name is too long


# --------------------------------------------------------------------------------------------------

MISSING = "missing"
LIBRARIES = ("numpy", "numba", "llvmlite", "torch", "onnxruntime", "pydantic")
"""Libraries that compute or parse data on which the advice is based; numba compiles loops of the
risk stage."""


class File(Settings):
    """A file that the configuration depends on."""

    path: str
    sha256: str


class Identity(Settings):
    """A cell at the time of validation.

    Attributes:
        config: dotted key -> value, all defaults included.
        config_hash: SHA-256 of ``config``.
        files: dotted key -> file that the key names or implies.
        versions: versions of this program, Python, the protocol and some libraries; hashes of the
            code of sources, links and predictors of third parties.
    """

    config: dict[str, JsonValue]
    config_hash: str
    files: dict[str, File]
    versions: dict[str, str]

    @property
    def hash(self) -> str:
        """SHA-256 of everything except the paths of the files."""
        hashes = {key: file.sha256 for key, file in self.files.items()}
        return _hash([self.config_hash, hashes, self.versions])


@dataclass(frozen=True, slots=True)
class Difference:
    """A difference: a key, and its value then and now (``None``: the key is missing)."""

    key: str
    old: str | None
    new: str | None

    def __str__(self) -> str:
        old, new = (_NONE if each is None else each for each in (self.old, self.new))
        return f"{self.key}: {old} -> {new}"


_NONE = "(none)"
_SHOWN = 80


def identity_of(config: Config) -> Identity:
    """Return the current identity of a cell.

    Raises:
        HriPredictError: a robot or trajectory named in the configuration is not shipped.
    """
    flat = flattened(canonical(config))
    files = {
        key: File(path=str(path), sha256=_hash_of_file(path))
        for key, path in sorted(dependencies(config, flat).items())
    }
    return Identity(
        config=flat, config_hash=_hash(flat), files=files, versions=versions() | _foreign(config)
    )


def canonical(config: Config) -> dict[str, Any]:
    """Return the parsed configuration as plain data."""
    whole = config.node.model_dump(mode="json", exclude={"commissioning"})
    whole["source"] = config.source.model_dump(mode="json")
    if parts := config.source.parts:  # as validated; its own block has them as they were written
        whole["source"][SENSORS] = {
            name: part.model_dump(mode="json") for name, part in parts.items()
        }
    whole["predictor"] = config.predictor.model_dump(mode="json")
    whole["links"] = [link.model_dump(mode="json") for link in config.links]
    return whole


def flattened(data: Any, key: str = "") -> dict[str, JsonValue]:
    """Return dotted key -> value; a list of plain numbers or texts is one value.

    Dots inside a name are escaped, so that no two values share a key. Named entries of a list are
    identified by name, not by position; the list's own key holds the names in order.
    """
    found: dict[str, JsonValue] = {}
    if isinstance(data, Mapping) and data:
        pairs = [(escaped(str(name)), each) for name, each in data.items()]
    elif isinstance(data, list) and any(isinstance(each, Mapping) for each in data):
        names = _own_names(data)
        if names is None:
            pairs = [(str(i), each) for i, each in enumerate(data)]
        else:
            found[key] = list[JsonValue](names)
            pairs = list(zip(map(escaped, names), data, strict=True))
    else:
        return {key: data}
    for name, each in pairs:
        found |= flattened(each, f"{key}.{name}" if key else name)
    return found


def _own_names(entries: list[Any]) -> list[str] | None:
    """Return the entries' names if every entry has a name and all names differ."""
    names = [each.get("name") if isinstance(each, Mapping) else None for each in entries]
    texts = [name for name in names if isinstance(name, str) and name]
    return texts if len(set(texts)) == len(entries) else None


def versions() -> dict[str, str]:
    """Return the installed versions."""
    found = {
        "hri-predict": __version__,
        "protocol": f"{SCHEMA_VERSION}, schema {SCHEMA_HASH:08x}",
        "python": platform.python_version(),
    }
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = MISSING
    found["compiled loops"] = "no" if why_not_compiled() else "yes"
    return found


def _foreign(config: Config) -> dict[str, str]:
    """Return the hashes of the code of third parties that the cell runs, like versions."""
    predictor = config.predictor
    codes = {f"the code of predictor '{predictor.name}'": registry.code_of(predictor)}
    for source in _sources(config.source).values():
        codes[f"the code of source '{source.kind}'"] = registry.code_of_part("sources", source.kind)
    for link in config.links:
        codes[f"the code of link '{link.kind}'"] = registry.code_of_part("links", link.kind)
    return {text: code[:16] for text, code in codes.items() if code is not None}


def differences(old: Identity, new: Identity) -> list[Difference]:
    """Return all differences, key by key: configuration, then files, then versions.

    A file that is missing or cannot be read is always one, because it may have changed.

    A named entry that exists only then or only now, such as a removed link, shows in its list's
    names; its own keys are not listed.
    """
    alone = _come_and_gone(old.config, new.config)
    found = [
        each
        for each in _compared(_texts(old.config), _texts(new.config))
        if not _is_in(each.key, alone)
    ]
    before = {key: file.sha256 for key, file in old.files.items()}
    now = {key: file.sha256 for key, file in new.files.items()}
    for key in sorted(before.keys() | now.keys()):
        is_same = before.get(key) == now.get(key) and _is_hash(now[key])
        if not is_same and not _is_in(key, alone):
            path = (new.files.get(key) or old.files[key]).path
            named = f"file of {key} ({os.path.basename(path)})"
            found.append(Difference(named, _short(before.get(key)), _short(now.get(key))))
    return found + [
        Difference(f"version of {each.key}", each.old, each.new)
        for each in _compared(old.versions, new.versions)
    ]


def _come_and_gone(old: Mapping[str, JsonValue], new: Mapping[str, JsonValue]) -> set[str]:
    """Return the keys of named entries that are in only one of the two lists."""
    found = set()
    for key in old.keys() & new.keys():
        then, now = (set(_listed(each, key)) for each in (old, new))
        found |= {f"{key}.{escaped(name)}" for name in then ^ now}
    return found


def _listed(config: Mapping[str, JsonValue], key: str) -> list[str]:
    """Return the names of a list's entries; none if the entries are unnamed."""
    value = config[key]
    names = [str(each) for each in value] if isinstance(value, list) else []
    return names if all(f"{key}.{escaped(name)}.name" in config for name in names) else []


def _is_in(key: str, entries: set[str]) -> bool:
    return any(key.startswith(f"{entry}.") for entry in entries)


def _compared(old: Mapping[str, str], new: Mapping[str, str]) -> list[Difference]:
    return [
        Difference(key, old.get(key), new.get(key))
        for key in sorted(old.keys() | new.keys())
        if old.get(key) != new.get(key)
    ]


def _texts(values: Mapping[str, JsonValue]) -> dict[str, str]:
    return {key: _text(value) for key, value in values.items()}


def _text(value: JsonValue) -> str:
    text = json.dumps(value, ensure_ascii=False, sort_keys=True)
    if len(text) <= _SHOWN:
        return text
    return f"{text[: _SHOWN - 20]}… (SHA-256 {_hash(value)[:8]})"  # so that no change is hidden


def _short(digest: str | None) -> str | None:
    return f"SHA-256 {digest[:12]}" if digest is not None and _is_hash(digest) else digest


def _is_hash(digest: str) -> bool:
    """Whether a file could be read; otherwise the text says why not."""
    return len(digest) == 64 and digest.isalnum()


def _hash(data: Any) -> str:
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _hash_of_file(path: Path) -> str:
    try:
        return file_hash(path) if path.is_file() else MISSING
    except OSError as error:
        return f"unreadable: {error.strerror}"
