"""The Python API of Sidestep: a client that follows and commands robots.

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)

`sidestep.api` lists the names. Each is imported at its first use, as the executable needs none.
"""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sidestep.api import *  # noqa: F403
else:

    def __getattr__(name):
        """Return a name of the API."""
        if not name.startswith("_"):
            public = _public_names()
            if name in public.__all__:
                return getattr(public, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__():
        """Return the names of the API."""
        return sorted(_public_names().__all__)

    def _public_names():
        """Return the module of the API; raise ImportError if another package shadows ours."""
        try:
            import sidestep.api as api  # `from sidestep` would ask __getattr__ for it
        except Exception as error:  # another package may raise anything
            from sidestep.__main__ import shadowing_package

            if conflict := shadowing_package():
                raise ImportError(conflict) from error
            raise
        return api
