"""Save pictures of the screen in the state folder."""

from itertools import count

from ground.user.folders import state_folder


def saved_picture(svg: str) -> str:
    """Save a picture under the next free name; return its path, or the error, in words."""
    folder = state_folder() / "pictures"
    names = (folder / f"sidestep-{number}.svg" for number in count(1))
    path = next(path for path in names if not path.exists())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(svg, encoding="utf-8")
    except OSError as error:
        return f"{path}: {error.strerror}"
    return f"saved {path}"
