"""`python -m gsgi.baker`: the command line."""

from gsgi.baker.cli.main import main

if __name__ == "__main__":
    main()
