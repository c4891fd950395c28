"""Forecasts of a folder of recordings, on a Ray cluster.

    pip install gnp[ray]
    python ray_predict.py --input tracks --output forecasts                      here, on two workers of one core each
    python ray_predict.py --input s3://bucket/tracks --output s3://bucket/forecasts --address auto

`--input` has one file of tracks a recording (Parquet or CSV with the columns id, time, x, y and what else `gnp.Model.predict`
takes), `--output` gets one Parquet file for each, under the same name. Either is a folder that all nodes see, or one of an
object store that pyarrow knows. Every worker loads the model once. A file appears when it is whole; a recording that has
one is not predicted again, so that the same command goes on after an interruption. A recording whose worker dies is done
by another one.
"""

import argparse
import os
import sys
import uuid

from pyarrow import csv, fs, parquet

SUFFIXES = (".parquet", ".csv", ".csv.gz")
DRAFT = ".parquet-draft"


def opened(place):
    """File system and path of a folder given as a path or as a URI."""
    if "://" in place:
        return fs.FileSystem.from_uri(place)
    return fs.LocalFileSystem(), os.path.abspath(place)


def recordings(source):
    """The files of tracks in a folder: name of the recording to path."""
    system, folder = opened(source)
    found = {}
    for info in system.get_file_info(fs.FileSelector(folder)):
        for suffix in SUFFIXES:
            if info.is_file and info.base_name.endswith(suffix) and not info.base_name.startswith("."):
                name = info.base_name.removesuffix(suffix)
                if name in found:
                    sys.exit(f"{source} has two recordings of the name {name}; rename one")
                found[name] = info.path
                break
    return dict(sorted(found.items()))


def finished(output):
    """Names of the recordings that have a file of forecasts."""
    system, folder = opened(output)
    names = [info.base_name for info in system.get_file_info(fs.FileSelector(folder, allow_not_found=True))]
    return {name.removesuffix(".parquet") for name in names if name.endswith(".parquet") and not name.startswith(".")}


def read(system, path):
    """A table of tracks."""
    if path.endswith(".parquet"):
        return parquet.read_table(path, filesystem=system)
    # By the name pyarrow sees whether it is compressed.
    with system.open_input_stream(path) as stream:
        return csv.read_csv(stream)


class Predict:
    """A worker: one model, one recording after the other."""

    def __init__(self, source, output, model, options):
        import gnp

        self.model = gnp.load(model)
        (self.source, _), (self.output, self.folder) = opened(source), opened(output)
        self.options = options

    def __call__(self, batch):
        rows = [self.one(name, path) for name, path in zip(batch["name"], batch["path"])]
        return {key: [row[key] for row in rows] for key in rows[0]}

    def one(self, name, path):
        final = f"{self.folder}/{name}.parquet"
        # The worker before may have died between this and its report.
        if self.output.get_file_info(final).is_file:
            return {"name": name, "rows": 0, "process": os.getpid()}
        forecasts = self.model.predict(read(self.source, path), out="pyarrow", **self.options)
        draft = f"{self.folder}/.{name}.{uuid.uuid4().hex}{DRAFT}"
        parquet.write_table(forecasts, draft, filesystem=self.output)
        self.output.move(draft, final)
        return {"name": name, "rows": forecasts.num_rows, "process": os.getpid()}


def sweep(output):
    """Removes drafts that killed workers left. To be called when none works."""
    system, folder = opened(output)
    for info in system.get_file_info(fs.FileSelector(folder)):
        if info.base_name.startswith(".") and info.base_name.endswith(DRAFT):
            system.delete_file(info.path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--input", required=True, help="folder of recordings")
    parser.add_argument("--output", required=True, help="folder of forecasts")
    parser.add_argument("--model", help="folder of a model that all nodes see; without it the one of the package")
    parser.add_argument("--at", type=float, help="time of the forecasts, s; without it the last of each recording")
    parser.add_argument("--every", type=float, help="a forecast each so many seconds instead")
    parser.add_argument("--k", type=int, default=6, help="paths a vehicle")
    parser.add_argument("--address", help="of a running cluster; without it a local one is started")
    parser.add_argument("--workers", type=int, default=2, help="one core each")
    arguments = parser.parse_args()
    all_of_them = recordings(arguments.input)
    done = finished(arguments.output)
    left = [{"name": name, "path": path} for name, path in all_of_them.items() if name not in done]
    print(f"{len(left)} of {len(all_of_them)} recordings to do", flush=True)
    if not left:
        return
    system, folder = opened(arguments.output)
    system.create_dir(folder, recursive=True)

    import ray

    if arguments.address:
        ray.init(address=arguments.address, log_to_driver=False)
    else:
        ray.init(num_cpus=arguments.workers, include_dashboard=False, log_to_driver=False)
    ray.data.DataContext.get_current().enable_progress_bars = False
    options = {"at": "last" if arguments.at is None else arguments.at, "k": arguments.k, "threads": 1}
    if arguments.every is not None:
        options |= {"at": "every", "every": arguments.every}
    places = (arguments.input, arguments.output, arguments.model, options)
    # A task a recording: what dies with a worker is one of them.
    reports = ray.data.from_items(left, override_num_blocks=len(left)).map_batches(
        Predict, fn_constructor_args=places, batch_size=1, concurrency=arguments.workers, num_cpus=1
    )
    for number, row in enumerate(reports.iter_rows(), 1):
        print(f"{number} of {len(left)}: {row['name']}, {row['rows']} rows, by process {row['process']}", flush=True)
    sweep(arguments.output)
    ray.shutdown()


if __name__ == "__main__":
    main()
