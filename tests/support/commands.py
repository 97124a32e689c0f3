"""The program called in this process, as a user's shell would."""

import pytest

from cosim.cli import main


def ended(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of `cosim WORDS`; what was captured before is dropped."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    code = left.value.code or 0
    assert isinstance(code, int)
    return code, *capsys.readouterr()


def told(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str]:
    """Exit code, and all that `cosim WORDS` says on both streams."""
    code, out, err = ended(capsys, *words)
    return code, out + err
