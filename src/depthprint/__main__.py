"""``python -m depthprint`` is the command line."""

from depthprint.cli.main import main

if __name__ == "__main__":
    main()
