"""Numbers in and out: numpy arrays where numpy is installed, nested lists where it is not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, List, Sequence, cast

try:
    import numpy
    HAS_NUMPY = True
except ImportError:
    HAS_NUMPY = False

if TYPE_CHECKING:
    import numpy.typing

    # Of doubles. Without numpy it is a list of the same shape, of lists of floats.
    FloatArray = numpy.typing.NDArray[numpy.float64]
    # Rows of numbers: a numpy array, or lists or tuples.
    Rows = numpy.typing.ArrayLike
else:
    FloatArray = Any
    Rows = Any


def array(values: Sequence[Any], *shape: int) -> FloatArray:
    """Returns `values` with the given shape, which only an empty array needs."""
    if not HAS_NUMPY:
        return cast("FloatArray", [*values])
    made = numpy.asarray(values, dtype=numpy.float64)
    return made if made.size or not shape else made.reshape(shape)


def columns(rows: Rows, names: Sequence[str], path: str) -> List[List[float]]:
    """Returns the columns of an [N, len(names)] table.

    Raises ValueError, with `path`, for any other shape and for what is not a number.
    """
    expected = f"{path}: expected rows of {len(names)} numbers ({', '.join(names)})"
    try:
        if HAS_NUMPY:
            matrix = numpy.asarray(rows, dtype=numpy.float64)
            shape, table = matrix.shape, matrix.T.tolist()
        else:
            plain = [tuple(map(float, row)) for row in cast(Any, rows)]
            shape = (len(plain), *{len(row) for row in plain})
            table = [list(column) for column in zip(*plain)]
    except (TypeError, ValueError) as error:
        raise ValueError(f"{expected}: {error}") from None
    if shape[:1] == (0,):
        return [[] for _ in names]
    if shape[1:] != (len(names),):
        raise ValueError(f"{expected}, and not of {' or '.join(map(str, shape[1:])) or 'none'}")
    return cast("List[List[float]]", table)
