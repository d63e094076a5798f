"""Records of numbers that kernels take cheaply, whose arrays they find by address, and the same without addresses."""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray


class Held:
    """A base of NamedTuples that keep the arrays whose addresses they hold.

    Examples:
        >>> from typing import NamedTuple
        >>> class Numbers(NamedTuple):
        ...     count: int
        ...     values: int  # address of float64 (count,)
        >>> class Kept(Held, Numbers):
        ...     pass
        >>> kept = Kept.holding(2, np.array([0.5, 1.5]))
        >>> kept.values == kept.held["values"].ctypes.data
        True
        >>> without_addresses(kept)
        {'program': 'Kept', 'count': 2, 'values': array([0.5, 1.5])}
    """

    held: dict[str, NDArray[Any]]  # by the field of their address

    @classmethod
    def holding(cls, *fields: Any) -> Self:
        """Take fields in order; arrays are held, and found by address."""
        made: Any = cls._make(one.ctypes.data if isinstance(one, np.ndarray) else one for one in fields)  # type: ignore[attr-defined]
        made.held = {name: one for name, one in zip(made._fields, fields, strict=True) if isinstance(one, np.ndarray)}
        return made  # type: ignore[no-any-return]

    @property
    def contents(self) -> dict[str, Any]:
        """Fields by name, arrays in place of their addresses."""
        return self._asdict() | self.held  # type: ignore[attr-defined, no-any-return]

    def _replace(self, **changes: Any) -> Self:
        """Return the record with other numbers or arrays."""
        return self.holding(*(self.contents | changes).values())


def without_addresses(record: Any) -> Any:
    """Return a record as a device takes it: the name of its program, and numbers and arrays by name.

    The program is whatever reads records of a class, which names it. What is no record stays as it is.
    """
    if not hasattr(record, "_fields"):
        return record
    parts = record.contents if isinstance(record, Held) else record._asdict()
    return {"program": type(record).__name__, **{name: without_addresses(part) for name, part in parts.items()}}
