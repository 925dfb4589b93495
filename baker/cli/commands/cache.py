"""`gsgi cache`: the finished tasks on disk."""

import argparse

from gsgi.baker.cli import options as shared


def add(commands) -> None:
    """Declare the command."""
    parser = shared.command(
        commands,
        "cache",
        run,
        "Show what the cache of finished tasks holds, or empty it.",
        "  gsgi cache\n"
        "  gsgi cache --clear\n"
        "  GSGI_CACHE_LIMIT=10GiB gsgi bake room.glb -o room.gsgi   # the most that a bake leaves (default: 4GiB)",
    )
    shared.add_cache(parser)
    parser.add_argument("--clear", action="store_true", help="remove all entries first")
    shared.add_json(parser)


def run(options: argparse.Namespace) -> None:
    """Print the folder, the entries and bytes in all and per stage, and the limit."""
    from gsgi.baker.cache.store import clear, default_folder, entries, size_limit
    from gsgi.baker.cli.json_output import print_json

    folder, limit = options.cache or default_folder(), size_limit()
    if options.clear:
        clear(folder)
    found = entries(folder)
    stages = {
        stage: {
            "entries": sum(entry.stage == stage for entry in found),
            "bytes": sum(entry.bytes for entry in found if entry.stage == stage),
        }
        for stage in sorted({entry.stage for entry in found})
    }
    count, size = len(found), sum(entry.bytes for entry in found)
    if options.json:
        print_json({"folder": str(folder), "entries": count, "bytes": size, "limit": limit, "stages": stages})
        return
    print(f"folder      {folder}\nentries     {count}\nbytes       {size}\nlimit       {limit}")
    for stage, sums in stages.items():
        print(f"  {stage:<10}{sums['entries']:>8} entries {sums['bytes']:>14} bytes")
