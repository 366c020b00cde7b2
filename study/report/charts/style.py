"""Colours and type of the report, light and dark.

A navigator has one colour everywhere (Okabe and Ito's colour-blind-safe set); passing on the right
is dashed.
"""

from typing import Final

COLOURS: Final = {
    "bug": ("#d55e00", "#ff8a3d"),
    "vgm": ("#b8860b", "#e6b422"),
    "bug1": ("#009e73", "#2fc99b"),
    "bug2": ("#3a9bd9", "#7cc4f2"),
    "distbug": ("#b0569a", "#df8fc9"),
    "vgm_memory": ("#0054a6", "#5b9dff"),
    "other": ("#5c5c5c", "#b5b5b5"),
}
"""Colour on a light and on a dark background."""


def colour(label: str) -> str:
    """Return the colour name of a navigator from its label."""
    name = label.partition(",")[0]
    return name if name in COLOURS else "other"


def dashed(label: str) -> str:
    """Return the class of a dashed line for passing on the right, else nothing."""
    return " right" if ", right" in label else ""


def _variables(which: int) -> str:
    return "".join(f"--{name}:{pair[which]};" for name, pair in COLOURS.items())


LIGHT: Final = (
    "--ink:#1c1e21;--soft:#5d636b;--rule:#d5d9de;--paper:#ffffff;--panel:#f5f6f8;"
    "--solid:#9aa1aa;--good:#00684a;--bad:#b3261e;--open:#7a5d00;--warm:213,94,0;--cool:0,84,166;"
    + _variables(0)
)
DARK: Final = (
    "--ink:#e7e9ec;--soft:#a3a9b2;--rule:#3a3f46;--paper:#15171a;--panel:#1e2125;"
    "--solid:#697079;--good:#4cc38a;--bad:#ff8d84;--open:#e2b93b;--warm:255,138,61;"
    "--cool:91,157,255;" + _variables(1)
)

_NAVIGATORS: Final = "".join(
    f".l-{name}{{stroke:var(--{name})}}.f-{name}{{fill:var(--{name})}}" for name in COLOURS
)

DRAWING_RULES: Final = (
    ".drawing{font:11px system-ui,'Segoe UI','DejaVu Sans',sans-serif}"
    ".drawing .ground{fill:var(--paper)}"
    ".drawing .label{fill:var(--ink)}.drawing .small{fill:var(--soft);font-size:10px}"
    ".drawing .head{fill:var(--ink);font-weight:600;font-size:12px}"
    ".drawing .on{fill:var(--paper);font-size:10px}"
    ".drawing .axis{stroke:var(--soft)}.drawing .grid{stroke:var(--rule)}"
    ".drawing .wanted{stroke:var(--ink);stroke-dasharray:2 3}"
    ".drawing .solid{fill:var(--solid)}.drawing .solidline{stroke:var(--solid);fill:none;"
    "stroke-linejoin:round;stroke-linecap:round}"
    ".drawing .mover{fill:var(--solid);fill-opacity:.35;stroke:var(--solid);stroke-dasharray:3 2}"
    ".drawing .moverline{stroke:var(--solid);stroke-dasharray:3 2;fill:none}"
    ".drawing .rim{fill:var(--panel);stroke:var(--solid);stroke-width:1.5}"
    ".drawing .way{fill:none;stroke-width:1.7;stroke-linejoin:round;stroke-linecap:round}"
    ".drawing .faint{opacity:.45;stroke-width:1}"
    ".drawing .right{stroke-dasharray:6 3}"
    ".drawing .believed{fill:none;stroke:var(--ink);stroke-width:1.1;stroke-dasharray:1.5 2.5}"
    ".drawing .doubt{fill:none;stroke:var(--ink);stroke-width:1.1}"
    ".drawing .straight{stroke:var(--soft);stroke-dasharray:5 4}"
    ".drawing .mark{stroke:var(--paper);stroke-width:1}"
    ".drawing .goal{fill:none;stroke:var(--ink);stroke-width:1.4}"
    ".drawing .start{fill:var(--ink)}"
    ".drawing .cross{stroke:var(--bad);stroke-width:2.2}"
    ".drawing .whisker{stroke-width:2}.drawing .thin{stroke-width:1.4;fill:none}"
    ".drawing .o-reached{fill:var(--vgm_memory)}.drawing .o-collided{fill:var(--bug)}"
    ".drawing .o-stuck{fill:var(--distbug)}.drawing .o-timeout{fill:var(--vgm)}"
    ".drawing .o-unreachable{fill:var(--bug2)}.drawing .o-lost{fill:var(--bug1)}"
    ".drawing .o-aborted{fill:var(--other)}.drawing .o-goal{fill:var(--bug2)}"
    ".drawing .o-left{fill:var(--bug1)}.drawing .o-right{fill:var(--distbug)}"
    ".drawing .o-align{fill:var(--vgm)}.drawing .o-other{fill:var(--other)}" + _NAVIGATORS
)

DRAWING_STYLE: Final = (
    f":root{{{LIGHT}}}@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}{DRAWING_RULES}"
)

PAGE_STYLE: Final = (
    f":root{{color-scheme:light dark;{LIGHT}}}"
    f"@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}"
    f":root[data-colours=light]{{color-scheme:light;{LIGHT}}}"
    f":root[data-colours=dark]{{color-scheme:dark;{DARK}}}"
    "header{display:flex;gap:1rem;align-items:baseline;justify-content:space-between}"
    "header button{font:inherit;font-size:.85rem;color:var(--soft);background:var(--panel);"
    "border:1px solid var(--rule);border-radius:.3rem;padding:.2rem .6rem;cursor:pointer}"
    "summary{cursor:pointer;color:var(--soft);font-size:.92rem;max-width:48rem;padding:.35rem 0}"
    "summary h3{display:inline;color:var(--ink)}details{margin:.5rem 0}"
    "th.sorts{cursor:pointer}th[aria-sort=ascending]::after{content:' \\25b2'}"
    "th[aria-sort=descending]::after{content:' \\25bc'}"
    "#verdict p{font-size:1.08rem}"
    "*{box-sizing:border-box}body{margin:0 auto;max-width:76rem;padding:1.5rem 1.25rem 4rem;"
    "background:var(--paper);color:var(--ink);"
    "font:16px/1.5 system-ui,'Segoe UI','DejaVu Sans',sans-serif}"
    "h1{font-size:1.75rem;line-height:1.2;margin:.5rem 0 1rem}"
    "h2{font-size:1.3rem;margin:2.75rem 0 .75rem;padding-top:.5rem;"
    "border-top:1px solid var(--rule)}"
    "h3{font-size:1.08rem;margin:1.75rem 0 .5rem}p,li{max-width:48rem}"
    "nav{background:var(--panel);padding:.6rem 1rem;border-radius:.4rem;font-size:.92rem}"
    "nav ol{margin:0;padding-left:1.25rem;columns:16rem}nav li{max-width:none}"
    "a{color:var(--vgm_memory)}code,pre{font-family:ui-monospace,'DejaVu Sans Mono',monospace;"
    "font-size:.86em;background:var(--panel);border-radius:.2rem}code{padding:.05em .3em}"
    "pre{padding:.6rem .8rem;overflow-x:auto;white-space:pre}pre code{padding:0}"
    ".wide{overflow-x:auto;margin:1rem 0}table{border-collapse:collapse;font-size:.88rem;"
    "font-variant-numeric:tabular-nums}caption{caption-side:top;text-align:left;"
    "padding:0 0 .4rem;color:var(--soft);max-width:min(48rem,90vw)}"
    "th,td{padding:.28rem .6rem;border-bottom:1px solid var(--rule);text-align:left;"
    "vertical-align:top}thead th{border-bottom:2px solid var(--soft);vertical-align:bottom}"
    "th{font-weight:600}tbody th{font-weight:500}"
    "td.figure,th.figure{text-align:right}td.figure,th.short{white-space:nowrap}"
    "thead th{max-width:9rem}"
    ".good{color:var(--good);font-weight:600}.bad{color:var(--bad);font-weight:600}"
    ".open{color:var(--open);font-weight:600}.none{color:var(--soft)}"
    "figure{margin:1rem 0}figcaption{font-size:.88rem;color:var(--soft);max-width:48rem;"
    "margin-top:.35rem}svg.drawing{max-width:100%;height:auto;display:block}"
    "section>figure{overflow-x:auto}section>figure svg.drawing{min-width:36rem}"
    ".gallery{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));gap:1.25rem}"
    ".gallery figure{margin:0;min-width:0}.gallery pre{font-size:.72rem;margin:.3rem 0 0}"
    "@media print{nav{display:none}figure,tr{break-inside:avoid}}"
)
