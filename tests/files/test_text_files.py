"""Files that a user gives: what is no regular text file is refused at once."""

import os

import pytest

from rock2d.diagnosis.predict import read_for_prediction
from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.text_files import read_json, read_text
from tests.files.test_scenario import DROPS
from tests.programs import refusal


@pytest.mark.parametrize("read", [load_scenario, read_for_prediction, read_text])
def test_pipes_devices_and_folders_are_refused_without_reading(tmp_path, read):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path):
        assert refusal(read, path, said="expected a file").code == "unreadable"


@pytest.mark.parametrize("name", ["experiment.yaml", "t.csv"])
def test_a_pipe_in_an_experiment_folder_is_refused(tmp_path, name):
    (tmp_path / "experiment.yaml").write_text(DROPS)
    (tmp_path / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match=rf"{name}: expected a file, found a pipe"):
        load_experiment(tmp_path)


def test_a_link_out_of_the_folder_does_not_show_what_it_leads_to(tmp_path):
    (tmp_path / "secret.txt").write_text("password: swordfish")
    folder = tmp_path / "film"
    folder.mkdir()
    (folder / "experiment.yaml").symlink_to(tmp_path / "secret.txt")
    assert "password" not in str(refusal(load_experiment, folder, said="leads out"))


@pytest.mark.parametrize(
    ("content", "code", "said"),
    [
        (b"[" * 100_000, "not_json", "nested too deeply"),
        (b'{"a": "\xff"}', "not_text", "0xff.*save the file as text in UTF-8"),
        (b'{"a": ' + b"1" * 5000 + b"}", "not_json", "too long"),
        (b'{"a": ]', "not_json", "not JSON"),
    ],
)
def test_json_that_cannot_be_read_is_said_in_one_line(tmp_path, content, code, said):
    path = tmp_path / "some.json"
    path.write_bytes(content)
    error = refusal(read_json, path, said=said)
    assert error.code == code and len(str(error)) < 300
