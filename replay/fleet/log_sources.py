"""List the logs of a fleet: files, folders, globs and prefixes of object storage."""

import glob
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

from estimators.errors import FleetError
from replay.fleet.object_store import S3, StoredObject, open_cached_store
from replay.logs import expand_log_folders, group_objects_by_log

_MAGIC: Final = "*?["


@dataclass(frozen=True, slots=True)
class FleetLog:
    """A log of a fleet.

    Attributes:
        source: path or address, as given by the user.
        place: address of the object storage that it is in; empty for a file.
        names: names of its objects.
        size_bytes: total size of its files.
        stamp: text that changes if one of its files changes.
    """

    source: str
    place: str
    names: tuple[str, ...]
    size_bytes: int
    stamp: str


def list_logs_of_sources(sources: Sequence[str]) -> list[FleetLog]:
    """List the logs in the sources, without duplicates, by name.

    Args:
        sources: logs, folders of logs, glob patterns, and `s3://bucket/prefix` with or without a
            pattern.

    Raises:
        FleetError: a source contains no log.
        PayscopeError: the storage does not answer.
    """
    found: dict[str, FleetLog] = {}
    for source in sources:
        logs = (
            _list_logs_of_bucket(source) if source.startswith(S3) else _list_logs_of_folder(source)
        )
        if not logs:
            raise FleetError(f"{source}: contains no log; give a log, a folder, a glob or s3://…")
        found |= {log.source: log for log in logs}
    return [found[name] for name in sorted(found)]


def _list_logs_of_folder(source: str) -> list[FleetLog]:
    named = [source]
    if any(each in source for each in _MAGIC) and not Path(source).exists():
        named = sorted(glob.glob(source, recursive=True))  # noqa: PTH207 - an absolute pattern
    paths = [Path(name).absolute() for name in named if Path(name).exists()]
    return [
        _make_fleet_log_of_path(path) for path in expand_log_folders(paths) if _is_path_a_log(path)
    ]


def _is_path_a_log(path: Path) -> bool:
    """Whether a path is a log: a file, or a folder with a metadata.yaml."""
    return not path.is_dir() or (path / "metadata.yaml").is_file()


def _make_fleet_log_of_path(path: Path) -> FleetLog:
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    stats = [each.stat() for each in files]
    return FleetLog(
        str(path),
        "",
        (),
        sum(each.st_size for each in stats),
        ",".join(str(each.st_mtime_ns) for each in stats),
    )


def _list_logs_of_bucket(source: str) -> list[FleetLog]:
    bucket, _, inside = source.removeprefix(S3).partition("/")
    place = f"{S3}{bucket}"
    fixed = inside
    for magic in _MAGIC:
        fixed = fixed.partition(magic)[0]
    folder = fixed if fixed == inside else fixed.rpartition("/")[0]
    one = open_cached_store(place).find_object(inside) if inside and fixed == inside else None
    objects = (
        [one] if one is not None else open_cached_store(place).list_objects(folder.rstrip("/"))
    )
    by_name = {each.name: each for each in objects}
    if fixed != inside:
        by_name = {n: o for n, o in by_name.items() if PurePosixPath(n).match(inside)}
    return [
        _make_fleet_log_of_objects(place, log, [by_name[name] for name in names])
        for log, names in group_objects_by_log(list(by_name)).items()
    ]


def _make_fleet_log_of_objects(
    bucket_address: str, log_name: str, objects: list[StoredObject]
) -> FleetLog:
    return FleetLog(
        f"{bucket_address}/{log_name}",
        bucket_address,
        tuple(each.name for each in objects),
        sum(each.size_bytes for each in objects),
        ",".join(each.stamp for each in objects),
    )
