"""Define the five themes for Textual; colours by role are in `ground.app.widgets.role_colours`."""

from typing import Final

from textual.theme import Theme

RULE: Final = "rule-color"


def _native(name: str, accent: str, warning: str, error: str, success: str) -> Theme:
    """Return a theme that leaves the colours to the terminal."""
    plain = "ansi_default"
    return Theme(
        name=name,
        primary=accent,
        warning=warning,
        error=error,
        success=success,
        foreground=plain,
        background=plain,
        surface=plain,
        panel=plain,
        boost=plain,
        ansi=True,
        variables={
            RULE: plain,
            "ansi-background": "ansi_black",
            "ansi-foreground": "ansi_white",
            "input-cursor-text-style": "reverse",
            "input-cursor-background": plain,
            "input-cursor-foreground": plain,
            "block-cursor-background": plain,
            "block-cursor-foreground": plain,
            "block-cursor-text-style": "reverse",
        },
    )


THEMES: Final = (
    Theme(
        name="dark",
        primary="#6cb6ff",
        secondary="#56cfd2",
        warning="#ecc46a",
        error="#ff6f6f",
        success="#7fd88f",
        accent="#6cb6ff",
        foreground="#d5dce4",
        background="#10151c",
        surface="#161d26",
        panel="#1b232e",
        variables={RULE: "#313c49"},
    ),
    Theme(
        name="light",
        primary="#0b5cad",
        secondary="#007a80",
        warning="#8a5a00",
        error="#b3121d",
        success="#176f2c",
        accent="#0b5cad",
        foreground="#1d2630",
        background="#fafbfc",
        surface="#f0f2f5",
        panel="#e6eaee",
        dark=False,
        variables={RULE: "#c5ccd4"},
    ),
    Theme(
        name="contrast",
        primary="#ffff00",
        secondary="#00ffff",
        warning="#ffff00",
        error="#ff4040",
        success="#00ff66",
        accent="#ffff00",
        foreground="#ffffff",
        background="#000000",
        surface="#000000",
        panel="#000000",
        variables={RULE: "#ffffff"},
    ),
    _native("ansi", "ansi_blue", "ansi_yellow", "ansi_red", "ansi_green"),
    _native("mono", *("ansi_default",) * 4),
)
