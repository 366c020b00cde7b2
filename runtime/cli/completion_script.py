"""`completion`: print the script that lets a shell complete the command line.

The scripts ask `sidestep complete` for the words that fit, and let the shell complete file names
where there are none.
"""

import argparse
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from runtime.cli.parsers import new_parser

BASH: Final = """\
# In ~/.bashrc: source <(sidestep completion bash)
_sidestep() {
    local word
    COMPREPLY=()
    while IFS=$'\\t' read -r word _; do
        COMPREPLY+=("$(printf %q "$word")")
    done < <(sidestep complete -- "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
    if [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *[/=] ]]; then
        compopt -o nospace 2>/dev/null
    fi
}
complete -o default -F _sidestep sidestep
"""
ZSH: Final = """\
#compdef sidestep
# In ~/.zshrc, after compinit: source <(sidestep completion zsh)
_sidestep() {
    local line word
    local -a described plain open
    while IFS= read -r line; do
        word=${line%%$'\\t'*}
        if [[ $line == *$'\\t'* ]]; then described+=("${word//:/\\\\:}:${line#*$'\\t'}")
        elif [[ $word == *[/=] ]]; then open+=("$word")
        else plain+=("$word")
        fi
    done < <(sidestep complete -- "${(@)words[2,CURRENT]}" 2>/dev/null)
    if (( ${#described} + ${#plain} + ${#open} == 0 )); then
        _files
        return
    fi
    (( ${#described} )) && _describe verb described
    (( ${#plain} )) && compadd -- "${plain[@]}"
    (( ${#open} )) && compadd -S '' -- "${open[@]}"
}
compdef _sidestep sidestep
"""
FISH: Final = """\
# In ~/.config/fish/config.fish: sidestep completion fish | source
function __sidestep_complete
    set -l words (commandline -opc) (commandline -ct)
    set -l found (sidestep complete -- $words[2..-1] 2>/dev/null)
    if test (count $found) -gt 0
        printf '%s\\n' $found
    else
        __fish_complete_path (commandline -ct)
    end
end
complete -c sidestep -f -a '(__sidestep_complete)'
"""
SCRIPTS: Final[Mapping[str, str]] = MappingProxyType({"bash": BASH, "zsh": ZSH, "fish": FISH})


def main(argv: Sequence[str]) -> int:
    """Print the script; return 0."""
    print(SCRIPTS[parser().parse_args(argv).shell], end="")
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    made = new_parser("completion")
    help = "the first line of the script says where it goes"
    made.add_argument("shell", choices=SCRIPTS, help=help)
    return made
