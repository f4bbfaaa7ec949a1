"""What `resolution` says of slow noise."""

import pytest


@pytest.mark.parametrize(
    ("base", "drift", "words"),
    [
        ("bench", "pointing_nm_rthz: 1", "and the slow noise of sensor.drift."),
        ("paper", "flicker_corner_hz: 100", "sensor.drift has no effect, since flicker_corner_hz"),
        ("paper", "", "the configuration has no sensor.drift"),
    ],
)
def test_slow_noise_is_said_to_be_there_where_it_has_an_effect(
    run_in_process, tmp_path, base, drift, words
):
    text = f"extends: {base}\n" + (f"sensor: {{drift: {{{drift}}}}}\n" if drift else "")
    (tmp_path / "mine.yaml").write_text(text, "utf-8")
    status, out, err = run_in_process("resolution", "mine.yaml", "-d", "out")
    assert status == 0, err
    assert words in " ".join(out.split())
