"""The exception for wrong input, as opposed to a defect in this package."""


class InputError(ValueError):
    """Wrong input; the message is one sentence on what was wrong, where, and what would be right.

    Commands print the message and exit with code 2; library users may catch it as a :class:`ValueError`.

    >>> from avssl_pyro.acoustics.presets import resolve_array
    >>> try:
    ...     resolve_array("circle7")
    ... except InputError as error:
    ...     print(error)
    array 'circle7' is neither a preset (circle2, ...) nor a YAML file.
    """


def name_of(part: object) -> str:
    """Name of a function or class, or of an object's class, for messages; a ``repr`` may hold an address.

    >>> name_of(InputError("no such file"))
    'InputError'
    """
    return str(getattr(part, "__name__", type(part).__name__))
