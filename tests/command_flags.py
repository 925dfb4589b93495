"""Flags of the command line."""


def flags(**values: float) -> list[str]:
    """`--view-size 24` for view_size=24, and so on."""
    return [word for name, value in values.items() for word in (f"--{name.replace('_', '-')}", str(value))]
