"""Files that are replaced only once their new content is complete; see `pirrht.files`."""

from pirrht.files import replaced

__all__ = ["replaced"]
