import csv

from fauna.io.csv_log import CsvLog


def rows(folder) -> list[dict[str, str]]:
    with (folder / "logs" / "metrics.csv").open(newline="") as handle:
        return [{name: value for name, value in row.items() if value} for row in csv.DictReader(handle)]


def test_columns_may_come_and_go(tmp_path):
    log = CsvLog(save_dir=str(tmp_path))
    log.log_metrics({"b": 1.0}, 0)
    log.log_metrics({"b": 2.0, "a": 3.0}, 1)
    log.log_metrics({"a": 4.0}, 2)
    assert rows(tmp_path) == [
        {"step": "0", "b": "1.0"},
        {"step": "1", "a": "3.0", "b": "2.0"},
        {"step": "2", "a": "4.0"},
    ]
    assert (tmp_path / "logs/metrics.csv").read_text().splitlines()[0] == "step,a,b"


def test_second_session_goes_on_from_its_first_step(tmp_path):
    first = CsvLog(save_dir=str(tmp_path))
    for step in range(4):
        first.log_metrics({"a": float(step)}, step)
    second = CsvLog(save_dir=str(tmp_path))
    for step in (2, 3, 4):
        second.log_metrics({"a": 10.0 + step}, step)
    assert [row["a"] for row in rows(tmp_path)] == ["0.0", "1.0", "12.0", "13.0", "14.0"]
