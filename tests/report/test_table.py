from rsvideo.report.table import DOES_NOT_APPLY, Row, Table, written

TABLE = Table(
    methods=("none", "rectify", "rsvideo"),
    rows=(
        Row(kind="shift", case="shift_00", psnr={"none": 23.191, "rsvideo": 30.93}, why_not={"rectify": DOES_NOT_APPLY}),
        Row(kind="shift", case="shift_01", psnr={"none": 29.2, "rsvideo": 35.0}, why_not={"rectify": DOES_NOT_APPLY}),
        Row(kind="clips", case="pan_640", psnr={"rectify": 31.0, "rsvideo": 31.004}, why_not={"none": "memory ran out"}),
    ),
)


def test_markdown_marks_the_best_and_gives_means_by_kind() -> None:
    assert written(TABLE, "markdown").splitlines() == [
        "| PSNR, dB | none | rectify | rsvideo |",
        "|---|---:|---:|---:|",
        "| shift_00 | 23.19 | - | **30.93** |",
        "| shift_01 | 29.20 | - | **35.00** |",
        "| pan_640 | - | **31.00** | **31.00** |",
        "| *mean of shift* | 26.20 | - | **32.97** |",
        "| *mean of clips* | - | **31.00** | **31.00** |",
        "",
        f"- rectify: {DOES_NOT_APPLY} (shift_00, shift_01)",
        "- none: memory ran out (pan_640)",
    ]


def test_latex_is_a_whole_tabular_with_its_underscores_escaped() -> None:
    text = written(TABLE, "latex")
    assert text.startswith("\\begin{tabular}{lrrr}")
    assert "  shift\\_00 & 23.19 & - & \\textbf{30.93} \\\\" in text.splitlines()
    assert "\\end{tabular}" in text
    assert all(line.count("&") == 3 for line in text.splitlines() if line.endswith("\\\\"))


def test_csv_leaves_empty_what_there_is_not() -> None:
    assert written(TABLE, "csv").splitlines()[1] == "shift,shift_00,23.1910,,30.9300"


def test_only_a_method_that_applies_can_fail() -> None:
    assert TABLE.failed
    assert not Table(methods=TABLE.methods, rows=TABLE.rows[:2]).failed
