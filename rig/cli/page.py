"""The verb of the command line for the operator's page; no logic."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from rig.errors import UsageError
from rig.terminal import say


def serve(
    folder: Annotated[Path, Parameter(help="Folder of the sessions; made if it does not exist.")] = Path("runs"),
    *,
    host: Annotated[str, Parameter(help="Address to listen on; others than this machine's own need --token.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, Parameter(help="Port to listen on; 0: any that is free.")] = 8080,
    token: Annotated[str | None, Parameter(help="Word that pages need, at least 16 signs; new: one is made.")] = None,
    show: Annotated[str | None, Parameter(help="Saved show to run from the beginning, and again when it ends.")] = None,
    opens: Annotated[bool, Parameter(name="--open", negative="", help="Open the page in this machine's browser.")] = (
        False
    ),
) -> int:
    """Serve the operator's page: look, set up, run, compare and show in a browser; until Ctrl-C.

    Needs the extra `page`: pip install 'procam-rig[page]'.

    Example: rig serve runs --open
    """
    try:
        from rig.page.serve import ServeRequest, serve_page
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the page needs {error.name}, which is not installed: pip install 'procam-rig[page]'"
        ) from error
    request = ServeRequest(root=folder, host=host, port=port, token=token, show=show, opens=opens)
    serve_page(request, lambda address: say(f"{address}\nCtrl-C ends it"))
    return 0
