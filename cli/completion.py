"""`massprops completion`: a script for the shell."""

from __future__ import annotations

from typing import Annotated

import typer

from massprops.errors import InputError
from massprops_cli.terminal import say

SHELLS = {
    "bash": """_massprops_completion() {
    local IFS=$'\n'
    COMPREPLY=( $( env COMP_WORDS="${COMP_WORDS[*]}" COMP_CWORD=$COMP_CWORD _MASSPROPS_COMPLETE=complete_bash $1 ) )
    return 0
}
complete -o default -F _massprops_completion massprops""",
    "zsh": """#compdef massprops
_massprops_completion() {
  eval $(env _TYPER_COMPLETE_ARGS="${words[1,$CURRENT]}" _MASSPROPS_COMPLETE=complete_zsh massprops)
}
compdef _massprops_completion massprops""",
    "fish": (
        'complete --command massprops --no-files --arguments "(env _MASSPROPS_COMPLETE=complete_fish '
        '_TYPER_COMPLETE_FISH_ACTION=get-args _TYPER_COMPLETE_ARGS=(commandline -cp) massprops)" --condition '
        '"env _MASSPROPS_COMPLETE=complete_fish _TYPER_COMPLETE_FISH_ACTION=is-args '
        '_TYPER_COMPLETE_ARGS=(commandline -cp) massprops"'
    ),
}


def command(shell: Annotated[str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.")]) -> None:
    """Print a script that completes commands, options and files. Put it into a file that your shell reads at its start.

    Example: massprops completion bash >> ~/.bashrc
    """
    if shell not in SHELLS:
        raise InputError(f"{shell}: there is no script for this shell; give one of {', '.join(SHELLS)}")
    say(SHELLS[shell])
