#!/usr/bin/env python3
"""Take the picture of README, docs/pictures/report.png: the first screen of the report of the scenario `experiment`.

    python scripts/draw_pictures.py [BROWSER]   # Chromium, or a browser based on it
"""

import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "docs" / "pictures" / "report.png"
SCENARIO = "experiment"
# Instant of the animation.
INSTANT_S = 0.117


def main():
    """Run the scenario and take the picture; returns the exit code."""
    browser = sys.argv[1] if len(sys.argv) > 1 else "chromium"
    with tempfile.TemporaryDirectory() as folder:
        command = ["cargo", "run", "--release", "--quiet", "--", "simulate", SCENARIO, "--report", folder]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        subprocess.run([
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
            "--disable-background-networking", "--disable-component-update", "--hide-scrollbars", f"--user-data-dir={folder}/profile",
            "--window-size=1280,900", "--virtual-time-budget=10000", f"--screenshot={PICTURE}",
            f"{Path(folder, 'index.html').as_uri()}#t={INSTANT_S}",
        ], check=True, capture_output=True)
    print(f"took {PICTURE.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
