"""Renders the samples that ship with the project: python samples/make.py

Each is made by the command `rsvideo simulate` from a photograph inside the scikit-image package; README.md beside this file
states their sources and licences. The same command and seed give the same pixels.
"""

import subprocess
import sys
from pathlib import Path

import skimage.data

HERE = Path(__file__).resolve().parent
COMMANDS = {
    # an ordinary hand-held photograph: the frame, timing and focal length of the README's first command
    "coffee": "coffee.png --exposure 1/50 --readout 20ms --focal-px 1400 --shake --seed 3 --blur-px 14",
    # a wide lens and a roll of the wrist: blur that differs from corner to corner
    "astronaut": "astronaut.png --exposure 1/60 --readout 25ms --focal-px 420 --polynomial x:0,9,-14,4;y:0,-12,9;roll:0,0.05,-0.02"
    " --blur-px 12 --seed 1",
    # grey, 16 bits, no roll (the model of the paper), read from the bottom up
    "photographer": "camera.png --exposure 1/40 --readout 16ms --direction bottom-to-top --focal-px 1400 --motion shift --shake --seed 8"
    " --blur-px 20 --bits 16 --noise 0.002",
}


def main() -> None:
    """Write a folder a sample."""
    photographs = Path(skimage.data.__file__).parent
    command = Path(sys.executable).parent / "rsvideo"
    for name, words in COMMANDS.items():
        source, *options = words.split()
        folder = HERE / name
        folder.mkdir(exist_ok=True)
        run = [command, "simulate", photographs / source, "-o", folder / "blurred.png", "--overwrite", *options]
        subprocess.run(run, check=True)


if __name__ == "__main__":
    main()
