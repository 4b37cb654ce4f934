"""The entry point of ``rnc-pin``: imports the command line in such a way that Ctrl-C meanwhile is one line too."""

from rnc_pin.app.interruption import interruptible_imports

with interruptible_imports():
    from rnc_pin.app.command_line import main

__all__ = ["main"]

if __name__ == "__main__":
    main()
