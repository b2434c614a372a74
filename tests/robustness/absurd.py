"""Values of options that no request can mean, and which exit codes are right for them."""

from collections.abc import Mapping, Sequence

from tests.robustness.case import Fault

_TIMES = (
    "0",
    "-1",
    "20",
    "1/0",
    "1/-50",
    "nan",
    "inf",
    "1e400",
    "9" * 5000,
    "1e99999999",
    "",
    " ",
    "0x10",
    "1/50/2",
    "50%",
    "1,5ms",
    "20mm",
    "\x1b[31m",
)
_WHOLE = ("0", "-1", "1.5", "1e3", "nan", "9" * 5000, "", "zwölf", "0x20", "None")
_CHOICES = ("", "NONE", "none ", "all", "../none", "none\n", "x" * 3000, "\x1b]0;x\x07", "0", "{}")
_FILES = (
    "",
    "absent.csv",
    ".",
    "/",
    "/dev/null",
    "/dev/zero",
    "\n",
    "x" * 300,
    "/etc/passwd",
    "in.png",
    "loop",
    "pipe",
    "http://127.0.0.1:9/x.csv",
)
ABSURD: Mapping[str, tuple[Sequence[str], Fault]] = {
    "--exposure": (_TIMES, Fault.OPTION),
    "--readout": (tuple(word for word in _TIMES if word != "0"), Fault.OPTION),
    "--row-time": (("-1", "0.5", "nan", "1/0", "9" * 5000, ""), Fault.OPTION),
    "--focal-px": (("0", "-3", "nan", "inf", "1e400", "", "4.2mm", "9" * 5000, "1e-300", "px"), Fault.OPTION),
    "--degree": (("0", "13", *_WHOLE[2:]), Fault.OPTION),
    "--method": (_CHOICES, Fault.OPTION),
    "--prior": (_CHOICES, Fault.OPTION),
    "--quality": (_CHOICES, Fault.OPTION),
    "--motion": (_CHOICES, Fault.OPTION),
    "--start": (_CHOICES, Fault.OPTION),
    "--refinement": (_CHOICES, Fault.OPTION),
    "--direction": (_CHOICES, Fault.OPTION),
    "--transfer": (_CHOICES, Fault.OPTION),
    "--block-rows": (("0", "15", "100001", *_WHOLE[2:]), Fault.OPTION),
    "--threads": (("0", "-4", "1025", *_WHOLE[2:]), Fault.OPTION),
    "--camera": (
        ("", "nobody", "../../etc/passwd", "absent.yaml", "/dev/zero.yaml", "x" * 3000, "\x1b[2J", "loop.yaml", "pipe.yaml"),
        Fault.NAME,
    ),
    "--trajectory": (_FILES, Fault.NAME),
    "--gyro": (_FILES, Fault.NAME),
    "--gyro-offset": (("nan", "inf", "1e7", "", "x", "9" * 5000), Fault.OPTION),
    "--gyro-axes": (("", "XY", "XYZZ", "abc", "XYZ\n", "ХУZ"), Fault.OPTION),
}
OF_CLIPS: Mapping[str, tuple[Sequence[str], Fault]] = {
    "--range": (("", "5-1", "1-1", "-1-2", "00:99:99-x", "9" * 5000, "1e9-1e10", "100-200", "nan-nan", "0-0"), Fault.OPTION),
    "--shutter-angle": (("0", "361", "-180", "nan", "", "inf", "9" * 400), Fault.OPTION),
    "--scanlines-total": (("0", "1000001", "5", *_WHOLE[2:]), Fault.OPTION),
    "--codec": (_CHOICES, Fault.OPTION),
    "--crf": (("-1", "64", "nan", "inf", "", "9" * 400), Fault.OPTION),
    "--pixel-format": (("", "yuv 420p", "nothing", "x" * 3000, "yuv420p;rm", "rgb24\n", "../x"), Fault.OPTION),
    "--on-damage": (_CHOICES, Fault.OPTION),
    "--frames": (_CHOICES, Fault.OPTION),
    "--path": (_CHOICES, Fault.OPTION),
}
RATES = ("0", "-24", "nan", "inf", "1e99999999", "24/0", "1/0", "9" * 4000, "1/" + "9" * 4000, "", "24000/1001/2", "1e-9", "1e9", "x")
