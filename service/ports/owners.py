"""What belongs to one project stays with it."""


def narrowed(present: str | None, owner: str) -> str:
    """Give the project that a store is to be bound to; None: it knows all projects so far.

    Raises
    ------
    PermissionError
        The store is bound to another project already: no way leads from one to another.
    """
    if present not in {None, owner}:
        raise PermissionError("a store of one project cannot become that of another")
    return owner
