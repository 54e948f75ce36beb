"""Draw the icons of the FMUs: modelDescription/*.svg to PNG.

Without arguments it writes a PNG beside each SVG; with ``--check`` it only
reports whether the PNGs are current.

It needs one package, which includes a renderer::

    pip install resvg-py==0.5.0
"""

import argparse
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

# Other versions may round pixels differently, and the PNGs are compared byte by byte.
RENDERER = "resvg-py"
RENDERER_VERSION = "0.5.0"
SIZE_PX = 256
NAMES = (
    *("MagneticBearing", "FlatnessController", "AlgebraicEstimator"),
    *("MagneticSpindle", "SpindleController", "SpindleEstimator"),
    *("MagneticBearing4", "AxialBearing"),
)
FOLDER = Path(__file__).resolve().parent.parent / "modelDescription"


def render(svg):
    """Render a drawing.

    Parameters
    ----------
    svg : pathlib.Path
        The drawing.

    Returns
    -------
    bytes
        A PNG, SIZE_PX wide and high, on transparent ground.
    """
    import resvg_py

    text = svg.read_text(encoding="utf-8")
    return bytes(resvg_py.svg_to_bytes(svg_string=text, width=SIZE_PX, height=SIZE_PX))


def main(arguments=None):
    """Draw the icons or check them.

    Parameters
    ----------
    arguments : list of str, optional
        Command line without the name of the program.

    Returns
    -------
    int
        0 if all is well, 1 if an icon is not current, 2 if the renderer is
        missing or another version.
    """
    parser = argparse.ArgumentParser(description="Draw the icons of the FMUs.")
    parser.add_argument("--check", action="store_true", help="only say whether the icons are current")
    check = parser.parse_args(arguments).check

    try:
        found = version(RENDERER)
    except PackageNotFoundError:
        found = "none"
    if found != RENDERER_VERSION:
        print(f"{RENDERER} {RENDERER_VERSION} is needed, found {found}", file=sys.stderr)
        return 2

    stale = []
    for name in NAMES:
        png = FOLDER / f"{name}.png"
        wanted = render(FOLDER / f"{name}.svg")
        if png.is_file() and png.read_bytes() == wanted:
            continue
        if check:
            stale.append(png.name)
        else:
            png.write_bytes(wanted)
            print(f"drew {png.name}")
    for name in stale:
        print(f"{name} is not what its SVG gives; run scripts/draw_icons.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
