"""``python -m mvp``: the ``mvp-cell`` command."""

from mvp.cli.main import main

if __name__ == "__main__":
    main()
