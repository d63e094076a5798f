"""The paper's figures, made anew, and two more; each is written as soon as it is finished.

1  the tree in the H-augmented space, one panel per obstacle (Fig. 1)
2  snapshots of drives of the point at b = 0.1 and 0.3 (Fig. 2)
3  lengths of the car's best paths per class against the iteration, and its references (Fig. 3)
4  snapshots of a drive of the car (Fig. 4)
5  probability of each class at the start against b, sampled and by the grid
6  the classes of `crossing` and `closing_door` in space and time, around what moves

Those of the documents: --only 1,2,5,6 --format png --dpi 160 -o docs
"""

import argparse
import sys
from pathlib import Path

from figures import gallery, style
from figures.effort import Effort
from tqdm import tqdm

from pirrht.errors import PirrhtError
from pirrht.plotting.maps import pyplot
from sim.cli.parser import Parser


def main() -> int:
    """Make the figures; the exit status is 2 for bad input."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("figures"), metavar="DIR", help="folder (figures)")
    parser.add_argument("--format", choices=style.FORMATS, default="pdf", help="of the files (pdf)")
    parser.add_argument("--dpi", type=gallery.dots, default=style.DPI, metavar="N", help="dots per inch of PNG (300)")
    parser.add_argument("--only", metavar="1,3", help="figures to make (all)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of trees, samples and drives (0)")
    try:
        options = parser.parse_args()
        numbers, effort = gallery.chosen(options.only), Effort(seed=options.seed)
        pyplot("this script")
        gallery.open_folder(options.output)
        pieces = sum(gallery.FIGURES[number].pieces(effort) for number in numbers)
        with tqdm(total=pieces, desc="figures", leave=False, disable=None) as bar:
            for number in numbers:
                bar.set_postfix_str(gallery.FIGURES[number].text)
                file = gallery.make(number, options.output, options.format, effort, bar.update, dpi=options.dpi)
                bar.write(str(file))
    except PirrhtError as error:
        print(f"reproduce_figures.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("reproduce_figures.py: interrupted", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
