"""Validation of archives by fmpy and by the FMU manipulation toolbox, many in one process.

Each tool loads in about a second and makes parsers and schemas for every archive; here it does so once, and parses a name once.
"""

import contextlib
import functools
import io
import sys
from unittest import mock

import lark
import xmlschema
from fmpy.validation import validate_fmu
from fmu_manipulation_toolbox.cli.fmucontainer import fmucontainer
from fmu_manipulation_toolbox.cli.fmutool import fmutool

__all__ = ["fmucontainer", "fmutool", "run_tool", "validate_fmu"]

Lark = lark.Lark


@functools.cache
def _parser(grammar, start):
    """Make a parser that remembers its results, but not its errors."""
    parser = Lark(grammar, start=start)
    parser.parse = functools.cache(parser.parse)
    return parser


lark.Lark = _parser
xmlschema.XMLSchema = functools.cache(xmlschema.XMLSchema)


def run_tool(tool, *arguments):
    """Run a command of the toolbox, which must succeed.

    Parameters
    ----------
    tool : callable
        ``fmutool`` or ``fmucontainer``.
    *arguments : str
        Its arguments.

    Returns
    -------
    str
        Its output.
    """
    output = io.StringIO()
    with mock.patch.object(sys, "argv", [tool.__name__, *map(str, arguments)]), contextlib.redirect_stdout(output):
        try:
            tool()
        except SystemExit as end:
            raise RuntimeError(f"{tool.__name__} ended with {end.code}: {output.getvalue()[-2000:]}") from end
    return output.getvalue()
