"""Start `ground.launch.child_command` by its path, so that `ps` shows the verb and its robot."""

import sys
from importlib import import_module
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    sys.exit(import_module("ground.launch.child_command").main(sys.argv[1:]))
