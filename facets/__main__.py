"""`python -m facets` is the program `facets`, where no folder of programs is on the PATH."""

from facets.cli import program

if __name__ == "__main__":
    program()
