"""What `gsgi doctor` advises."""

from gsgi.baker.cli import machine_checks


def test_a_part_that_is_slow_need_not_be_installed(monkeypatch):
    monkeypatch.setattr(machine_checks, "TIMEOUT", 0.01)
    check = machine_checks._check("LLVM", "while True: pass", machine_checks.BAKES, "apt-get install libllvm19")
    assert (check.works, check.detail) == (False, "no answer within 0.01 s")
    assert check.advice == "try again when this machine is less busy"
