"""How values show themselves in a notebook: tables, drawings and formulas, told to IPython by name of their types."""

from collections.abc import Callable, Mapping
from typing import Any

from fmopt.notebook.sheets import freedom_sheet, pose_sheet, verdict_sheet
from fmopt.notebook.views import VIEWS, views_of


def introduce() -> None:
    """Tells the running IPython how values of this package are shown; without one, nothing happens."""
    from IPython import get_ipython

    shell = get_ipython()
    if shell is None:
        return
    html = shell.display_formatter.formatters["text/html"]
    for name, view in HTML.items():
        html.for_type_by_name(*name.rsplit(".", 1), view)


def _drawn(value: Any) -> str:
    return str(next(iter(views_of(value).values()))._repr_html_())


HTML: Mapping[str, Callable[[Any], str]] = {
    # Plans and problems have sheets, `_repr_html_`, which IPython asks for only where nothing is registered.
    **{name: _drawn for name in VIEWS if not name.startswith(("fmopt.notebook", "fmopt.task"))},
    "fmopt.spatial.se3.Pose": pose_sheet,
    "fmopt.verify.findings.Verdict": verdict_sheet,
    "fmopt.planning.plan_record.NominalMotion": lambda nominal: freedom_sheet(nominal.freedoms),
}
