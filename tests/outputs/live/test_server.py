"""The server of the page lets in its own page alone, and writes into the folder that was named."""

import http.client
import json
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

import flighttune as ft
from flighttune.base.files import table

MOVE = {"values": {}, "ghosts": {}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def page(folder):
    with ft.open("paper_as_printed", out=folder / "saved", browser=False) as opened:
        yield opened


def token_of(page):
    return page.url.split("/")[3]


def ask(page, path="", body=None, *, token=None, **headers):
    """Status, headers and body of an answer; headers are those of our page unless stated."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=300)
    told = {"Host": f"127.0.0.1:{page.port}"}
    if body is not None:
        told |= {"Origin": f"http://127.0.0.1:{page.port}", "Content-Type": "application/json"}
        body = body if isinstance(body, bytes) else json.dumps(body).encode()
    told |= {name.replace("_", "-"): value for name, value in headers.items()}
    given = {name: value for name, value in told.items() if value is not None}
    place = f"/{token_of(page) if token is None else token}/{path}"
    connection.request("GET" if body is None else "POST", place, body, given)
    answer = connection.getresponse()
    status, text = answer.status, b"" if path == "events" else answer.read()
    connection.close()
    return status, dict(answer.getheaders()), text


def test_the_page_and_a_picture_are_there_for_those_who_have_the_address(page):
    assert ask(page)[0] == 200
    status, _, text = ask(page, "picture", MOVE)
    assert status == 200
    assert "<svg" in json.loads(text)["pieces"]


def test_nothing_is_told_without_the_token(page):
    for token in ("x", "", "a" * 32, "%C3%A9", ".."):
        for path in ("", "events", "picture", "begin", "stop", "save"):
            body = None if path in ("", "events") else MOVE
            status, _, text = ask(page, path, body, token=token)
            assert status in (404, 405), (token, path)
            assert token_of(page).encode() not in text


def test_another_name_of_this_machine_is_refused(page):
    for host in ("evil.example", "evil.example:80", "127.0.0.1.evil.example", ""):
        for path in ("", "picture", "save"):
            status, _, _ = ask(page, path, MOVE if path else None, Host=host)
            assert status in (400, 404), (host, path)


def test_a_page_of_another_origin_moves_nothing(page):
    for origin in ("http://evil.example", "null", "https://127.0.0.1", None):
        for path in ("picture", "begin", "stop", "save"):
            assert ask(page, path, MOVE, Origin=origin)[0] == 404, (origin, path)


def test_a_page_of_another_origin_reads_nothing(page):
    assert ask(page, "", Origin="http://evil.example")[0] == 404
    assert ask(page, "", Sec_Fetch_Site="cross-site")[0] == 404
    assert "Access-Control-Allow-Origin" not in ask(page)[1]


def test_the_address_is_kept_from_others_and_the_page_out_of_frames(page):
    headers = {name.lower(): value for name, value in ask(page)[1].items()}
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]


def test_it_listens_on_this_machine_alone(page):
    listening = [x.laddr for x in psutil.Process().net_connections("tcp") if x.status == "LISTEN"]
    assert [x.ip for x in listening if x.port == page.port] == ["127.0.0.1"]


UNSENT = [
    b"",
    b"{",
    b"[]",
    b"null",
    b"{}",
    b'{"values": {}, "ghosts": 1}',
    b"[" * 2000,
    b"x" * 70_000,
    b'{"values": {"flight.V_a_mps": NaN}}',
    b'{"values": {"flight.V_a_mps": [25.0]}}',
    b'{"values": {}, "ghosts": {"a": {}, "b": {}, "c": {}, "d": {}, "e": {}, "f": {}}}',
]


def test_what_the_page_does_not_send_is_refused(page):
    for body in UNSENT:
        status, _, text = ask(page, "picture", body)
        assert status in (400, 413), body
        assert b"Traceback" not in text


UNFLOWN = [
    {"flight.V_a_mps": -1.0},
    {"flight.V_a_mps": 10**400},
    {"limits.phi_deg[1]": 10**400},
    {"limits.phi_deg[1]": -(10**300)},
    {"law[0].module": "x.py"},
    {"gains[0].K_P[0][0]": 1e300},
]


def test_a_value_that_cannot_be_flown_is_told_in_a_line(page):
    for values in UNFLOWN:
        status, _, text = ask(page, "picture", {**MOVE, "values": values})
        assert status == 200, values
        assert "must" in json.loads(text)["failed"]


def test_a_page_names_no_file_to_save(page, folder):
    def elsewhere():
        saved = folder / "saved"
        return {x for x in folder.parent.rglob("*") if saved not in (x, *x.parents)}

    before = elsewhere()
    for name in ("../../evil", "/tmp/flighttune_evil", "x"):
        names = dict.fromkeys(("folder", "out", "name", "path", "file"), name)
        assert "failed" not in json.loads(ask(page, "save", {"values": {}, **names})[2])
        assert elsewhere() == before
        assert not Path("/tmp/flighttune_evil").exists()


LAW = """
from pathlib import Path

Path(__file__).with_name("ran").write_text("x")


class Mine:
    signals = {}

    def __init__(self, setup):
        self.dt = setup.dt

    def start(self, condition):
        pass

    def step(self, measured, reference, t):
        return 0.0, 1.0
"""


@pytest.mark.counts
def test_a_recording_runs_no_code_that_it_names(tmp_path):
    (tmp_path / "law.py").write_text(LAW)
    scenario = ft.load_scenario("paper_as_printed", changes={"flight.duration_s": 0.5}).as_dict()
    own = {"name": "mine", "kind": "python", "module": str(tmp_path / "law.py"), "class": "Mine"}
    text = table.toml_text({**scenario, "law": [own], "gains": ["paper"], "expect": []})
    (tmp_path / "own.toml").write_text(text)
    # by a command of its own, because code that has run here once may do so again
    command = [sys.executable, "-m", "flighttune", "fly", "own.toml", "--out", "run", "-q"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=300)
    (tmp_path / "ran").unlink()
    with ft.open(tmp_path / "run", out=tmp_path / "saved", browser=False) as page:
        told = json.loads(ask(page, "picture", MOVE)[2])
        assert "law.py, which must be allowed by `--run-code`" in told["failed"]
    assert not (tmp_path / "ran").exists()


def test_a_port_that_is_taken_is_told_in_a_line(page):
    with pytest.raises(ft.InputError, match=rf"`port` must be free.*{page.port}"):
        ft.open("paper_as_printed", port=page.port, browser=False)


def test_a_page_that_is_closed_leaves_no_thread_and_no_port():
    threads = {*threading.enumerate()}
    page = ft.open("paper_as_printed", browser=False)
    page.close()
    end = time.monotonic() + 10.0
    while {x for x in threading.enumerate() if not x.name.startswith("AnyIO")} - threads:
        assert time.monotonic() < end
        time.sleep(0.05)
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", page.port)) != 0


def test_tables_say_which_of_their_cells_are_headings(page):
    numbers = json.loads(ask(page, "picture", MOVE)[2])["pieces"]
    assert 'scope="col"' in numbers
    assert '<th scope="row"' in numbers
    assert "R<sub>K</sub>" in numbers


def beside(page, count, sent=b""):
    """Connections that send these bytes and nothing else."""
    made = [socket.create_connection(("127.0.0.1", page.port), 10.0) for _ in range(count)]
    for connection in made:
        connection.sendall(sent)
    return made


def ends(connection):
    """Whether the server ends a connection; whatever it answers first is read."""
    connection.settimeout(20.0)
    try:
        while connection.recv(4096):
            pass
    except ConnectionError:
        pass
    except TimeoutError:
        return False
    return True


HEAD = b"POST /x/picture HTTP/1.1\r\nHost: 127.0.0.1\r\n"


@pytest.mark.soak
@pytest.mark.parametrize(
    "sent", [b"", b"GET / HT", HEAD, HEAD + b"Content-Length: 1000\r\n\r\n", b"\0" * 9]
)
def test_connections_without_the_token_take_no_place_of_the_page_and_end(page, sent):
    others = beside(page, 200, sent)
    try:
        assert ask(page)[0] == 200
        assert ask(page, "picture", MOVE)[0] == 200
        assert all(map(ends, others))
    finally:
        for connection in others:
            connection.close()


@pytest.mark.soak
def test_a_window_stays_longer_than_a_connection_may_wait(page):
    news = http.client.HTTPConnection("127.0.0.1", page.port, timeout=10.0)
    news.request("GET", f"/{token_of(page)}/events")
    answer, end = news.getresponse(), time.monotonic() + 6.0
    while time.monotonic() < end:
        assert answer.readline().startswith((b":", b"data", b"\n"))
    news.close()
