"""Attack the installed program from outside: ``python -m tests.weekly.outside``.

The program is run as a user runs it, and nothing of it is imported. All attacks take hours;
``--scale 0.01`` takes some minutes. Prints the numbers of trials and failures of each command, file
format or text, and up to 20 failures of each. The exit code is 1 if there is a failure.
"""

import argparse
import sys

from tests.weekly.outside.attacks import ATTACKS, attack


def main(arguments):
    parser = argparse.ArgumentParser(prog="python -m tests.weekly.outside", description=__doc__)
    names = [own.__name__ for own in ATTACKS]
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    n_failures = 0
    for name in options.only:
        for subject, n_trials, failures in attack(name, options.scale, options.seed):
            n_failures += len(failures)
            print(f"{name}: {subject}: {n_trials} trials, {len(failures)} failures", flush=True)
            for failure in failures[:20]:
                print(f"    {failure}", flush=True)
    return int(n_failures > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
