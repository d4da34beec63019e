"""``python -m service.cli``: the program where no script is installed, as ``torchrun -m`` wants it."""

from service.cli.app import main

main()
