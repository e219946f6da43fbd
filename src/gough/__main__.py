"""``python -m gough`` is the command ``gough``."""

from gough.cli import main

if __name__ == "__main__":
    main()
