"""Folders and files that nobody but this user or root may write to or replace."""

import os
import stat
from functools import cache
from pathlib import Path

try:
    import grp
    import pwd
except ImportError:  # a system without owners
    pass


class Foreign(OSError):
    """Somebody else owns the folder of the cache or one above it, or may write to it."""


def own(path: Path) -> Path:
    """Make a folder, if need be, and return it; Foreign where somebody else may put another one in its place."""
    for one in reversed([path, *path.parents]):
        if not one.exists():
            one.mkdir(mode=0o755, exist_ok=True)  # even for a user who lets everybody write
    if is_foreign(os.lstat(path)) or _is_below_foreign(path):
        raise Foreign
    return path


def is_foreign(found: os.stat_result, shared: int = 0) -> bool:
    """Return whether somebody else may have written something, or, of a link, what it leads to; `shared` bits aside."""
    if not hasattr(os, "geteuid"):  # there are no owners
        return False
    return found.st_uid not in (0, os.geteuid()) or bool(found.st_mode & 0o022 & ~shared) or stat.S_ISLNK(found.st_mode)


@cache
def _is_below_foreign(path: Path) -> bool:
    """Return whether somebody else may rename a folder above; not where the group is the user's own, or in /tmp."""
    for one in path.parents:
        found = os.stat(one)
        shared = 0o022 if found.st_mode & stat.S_ISVTX else 0o020 if _is_private(found.st_gid) else 0
        if is_foreign(found, shared):
            return True
    return False


def _is_private(number: int) -> bool:
    """Return whether a group is that of this user alone, as many systems make one for each."""
    try:
        group, user = grp.getgrgid(number), pwd.getpwuid(os.geteuid()).pw_name
    except (KeyError, NameError):
        return False
    return group.gr_name == user and set(group.gr_mem) <= {user}
