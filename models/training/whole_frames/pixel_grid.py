"""Which rows and columns of a frame are looked at, as slices: all of them, or some at equal distances."""

Grid = tuple[slice, slice]

WHOLE: Grid = (slice(None), slice(None))


def every(stride: int, row: int = 0, column: int = 0) -> Grid:
    """One of so many rows and columns, from these on."""
    return slice(row, None, stride), slice(column, None, stride)


def every_row(stride: int, row: int = 0) -> Grid:
    """One of so many rows, from this one on, with all columns."""
    return slice(row, None, stride), slice(None)
