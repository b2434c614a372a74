"""What the server refuses, and in which words."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.view.servers import Server, serving

CLIP = Path(__file__).resolve().parents[2] / "samples" / "clip" / "blurred.mp4"
HOSTILE = "<img src=x onerror=alert(1)>.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip, links that lead out, a job with a hostile name, and pages that only look like reports of ours."""
    top = tmp_path_factory.mktemp("opened")
    inside, outside = top / "inside", top / "outside"
    for each in (inside / "report", outside):
        each.mkdir(parents=True)
    (inside / "clip.mp4").write_bytes(CLIP.read_bytes())
    (outside / "secret.mp4").write_bytes(CLIP.read_bytes())
    (inside / "link.mp4").symlink_to(outside / "secret.mp4")
    (inside / "elsewhere").symlink_to(outside)
    (inside / HOSTILE).write_text("clips: [clip.mp4]\n")
    (inside / "report" / "report.json").write_text("{}")
    (inside / "report" / "index.html").write_text("<script>document.title = 'run'</script>")
    (inside / "page.html").write_text("<script>document.title = 'run'</script>")
    return inside


@pytest.fixture(scope="module")
def server(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(folder, state=tmp_path_factory.mktemp("state")) as running:
        yield running


def words(answer: tuple[int, bytes]) -> tuple[int, str]:
    """HTTP's number, and the sentence."""
    error = json.loads(answer[1])["error"]
    assert "\n" not in error
    return answer[0], error


@pytest.mark.parametrize("token", ["", "x", "wrong-token-of-a-stranger"])
def test_a_request_without_the_token_is_refused(server: Server, token: str) -> None:
    for path in ("", "api/folder", "static/view.css", "api/thumb?at=0/clip.mp4"):
        status, sentence = words(server.ask(path, token=token))
        assert (status, "token" in sentence) == (403, True)


def test_the_token_opens_every_page(server: Server) -> None:
    for path in ("", "clip", "jobs", "calibrate", "static/view.css", "static/report.css", "static/page.js"):
        assert server.ask(path)[0] == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1"])
def test_a_request_from_another_origin_is_refused(server: Server, origin: str) -> None:
    status, sentence = words(server.ask("api/folder", headers={"Origin": origin}))
    assert (status, "another page" in sentence) == (403, True)
    body = json.dumps({"at": "0/job.yaml"}).encode()
    headers = {"Origin": origin, "Content-Type": "application/json"}
    assert server.ask("api/jobs/start", method="POST", body=body, headers=headers)[0] == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_picture_that_another_site_embeds_is_refused(server: Server, site: str) -> None:
    embedded = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors"}
    assert server.ask("api/thumb?at=0/clip.mp4", headers=embedded)[0] == 403
    assert server.ask("", headers={"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate"})[0] == 200  # a link that a person follows


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "127.0.0.1:1", ""])
def test_another_name_of_this_machine_is_refused(server: Server, host: str) -> None:
    assert words(server.ask("api/folder", headers={"Host": host}))[0] == 421


def test_a_form_of_another_page_cannot_change_anything(server: Server) -> None:
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert server.ask("api/jobs/start", method="POST", body=b'{"at":"0/job.yaml"}', headers={"Content-Type": kind})[0] == 415


@pytest.mark.parametrize(
    "place",
    ["0/../outside/secret.mp4", "0//etc/passwd", "0/link.mp4", "0/elsewhere/secret.mp4", "0/..", "1/clip.mp4", "../x", "-1/x", "0/a%00b"],
)
def test_a_path_outside_the_folders_is_refused(server: Server, place: str) -> None:
    for address in ("api/thumb", "api/frame", "api/folder", "api/strip"):
        status, sentence = words(server.ask(f"{address}?at={place}"))
        assert status in (403, 422), sentence
        assert b"secret" not in server.ask(f"{address}?at={place}")[1].replace(b"secret.mp4", b"")
    assert server.ask(f"report/{place}")[0] in (403, 404, 422)


def test_a_setting_cannot_name_a_file_elsewhere(server: Server) -> None:
    for key, value in (("trajectory", "../outside/motion.json"), ("gyro", "/etc/passwd"), ("trajectory", "elsewhere/x.csv")):
        answer = server.tell("api/preview", at="0/clip.mp4", settings={"motion": {key: value}})
        assert answer["status"] == 403, answer
    answer = server.tell("api/facts", at="0/clip.mp4", settings={"camera": {"profile": "../outside/p.yaml"}})
    assert answer["status"] == 403


def test_a_job_cannot_be_saved_or_started_elsewhere(server: Server, folder: Path) -> None:
    for name in ("../outside/job", "/tmp/job", "a/b", ".hidden", "", "x" * 150, "nul\0"):
        answer = server.tell("api/save", at="0/clip.mp4", name=name, settings={"camera": {"exposure": "1/50"}})
        assert answer["status"] in (403, 422), (name, answer)
    assert server.tell("api/jobs/start", at="0/../outside/job.yaml")["status"] == 403
    assert sorted(path.name for path in (folder.parent / "outside").iterdir()) == ["secret.mp4"]


def test_a_long_request_is_refused(server: Server) -> None:
    headers = {"Content-Type": "application/json"}
    status, sentence = words(server.ask("api/facts", method="POST", body=b" " * 6_000_000, headers=headers))
    assert (status, "1 MB" in sentence) == (413, True)


def test_uploads_are_pictures_by_their_names_and_bounded(server: Server) -> None:
    session = server.tell("api/calibrate/session")["session"]
    assert server.ask(f"api/upload/{session}/view.png", method="PUT", body=b"x" * 2_000_000)[0] == 200
    for name in ("page.html", "..%2Fx.png", "x.yaml", ".png"):
        assert server.ask(f"api/upload/{session}/{name}", method="PUT", body=b"x")[0] in (404, 405, 422), name
    assert server.ask("api/upload/unknown/view.png", method="PUT", body=b"x")[0] == 404
    for number in range(119):
        assert server.ask(f"api/upload/{session}/{number}.png", method="PUT", body=b"x")[0] == 200
    assert words(server.ask(f"api/upload/{session}/last.png", method="PUT", body=b"x"))[0] == 413


def test_a_wrong_setting_is_one_sentence_with_its_field(server: Server) -> None:
    answer = server.tell("api/preview", at="0/clip.mp4", settings={"camera": {"exposure": "20"}})
    assert answer["status"] == 422
    assert "is it in milliseconds" in answer["faults"]["camera.exposure"]
    answer = server.tell("api/preview", at="0/clip.mp4", settings={"camera": {"exposre": "20ms"}})
    assert "no setting camera.exposre" in answer["error"]


def test_a_page_beside_the_clips_is_no_report_and_a_strangers_script_does_not_run(server: Server) -> None:
    assert server.ask("report/0/page.html")[0] == 422
    connection = server.ask("report/0/report/index.html")
    assert connection[0] == 200  # the browser's policy keeps its script from running: see the test of the pages


def test_no_error_is_a_traceback(server: Server) -> None:
    for path in ("api/preview/none", "api/errand/none", "nothing", "api/strip", "api/thumb?at=0/clip.mp4&side=-1", "static/..%2Fapp.py"):
        status, sentence = words(server.ask(path))
        assert 400 <= status < 500, path
        assert "Traceback" not in sentence
