"""Import of a Keras network: convert it, find out its input, and write a checkpoint."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from torch import nn

from datamodules.recorded_car import other_car
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.view import FRAME, View
from zoo.base.command_keys import typed
from zoo.base.compose import compose_config
from zoo.base.console_progress import progress_bar
from zoo.base.errors import InputError
from zoo.base.output_files import checked_file
from zoo.base.terminal import command_line, print_written
from zoo.base.whole_file import write_output
from zoo.checkpoints.checkpoint import PREFIX, make_card
from zoo.checkpoints.new_checkpoint import SUFFIX, checkpoint_bytes
from zoo.extras.keras.combinations import (
    SCALES,
    USUAL_RESIZE,
    Combination,
    KnownInput,
    Scale,
    likeliest_combination,
    read_trial_frames,
)
from zoo.extras.keras.import_options import ImportOptions
from zoo.extras.keras.import_tables import (
    architecture_table,
    input_table,
    print_judgement,
    trials_table,
)
from zoo.extras.keras.judgement import Judgement, search
from zoo.extras.keras.keras_file import KerasModel, read_keras_apart
from zoo.extras.keras.keras_layers import ConvertedKeras, convert
from zoo.extras.keras.keras_weights import backend_doubt
from zoo.extras.keras.layer_chain import is_channels_first
from zoo.extras.keras.tied_drives import drive_tied
from zoo.extras.keras.trials import Trial
from zoo.models.make_network import make_network
from zoo.scoring.evidence import next_drive

IMPORTED = "imported"  # key of a checkpoint that an import wrote; its value is the file's name
FILE, KEY, SEARCH, GUESS = "the file", "your key", "trying on the recording", "a guess"


def import_network(file: str, options: ImportOptions, console: Console) -> Path:
    """Convert a Keras file, print what was understood, and return the written checkpoint's path.

    Raises:
        InputError: the file or the recording cannot be read or used, something that must be known
            is not, or the checkpoint cannot be written.
    """
    path = Path(file).expanduser()
    inputs: list[str | Path] = [path, *([options.weights] if options.weights else [])]
    out = checked_file(options.out or path.stem + SUFFIX, [SUFFIX], inputs=inputs, into_folder=True)
    model = read_keras_apart(path, Path(options.weights).expanduser() if options.weights else None)
    recording = read_recordings(options.recording) if options.recording else None
    converted, facts = _known(model, options, searches=recording is not None)
    console.print(architecture_table(path.name, converted.notes, console.width))
    if doubt := backend_doubt(model, is_channels_first(converted.layers)):
        text = f"warning: {path}{doubt}; if it steers badly, name Theano in a copy of the weights' "
        text += "file, and import that: h5py.File('COPY.h5', 'a').attrs['backend'] = 'theano'"
        console.print(text, highlight=False, markup=False, soft_wrap=True)
    if recording is None:
        chosen, rest = likeliest_combination(facts), GUESS
    else:
        judged = find_input(path, converted, facts, recording, options, console)
        chosen, rest = judged.best.combination, SEARCH
        if (frame := recording.frame_size()) and frame != chosen.view.frame:
            view = replace(chosen.view, size=chosen.view.shape[:2], frame=frame)
            chosen = replace(chosen, view=view)
    sources = _sources(facts, options, rest)
    console.print(input_table(chosen, options.steering, sources, console.width))
    if recording is None:
        _warn_of_guesses(facts, chosen, _again(path, replace(options, recording="FOLDER")), console)
    source = "donkeycar" if model.is_donkeycar else None
    data = _write(out, path, converted, chosen, recording, source)
    print_written([out], next_drive(out, data, ["evaluate", out, "track=udacity_lake"]), console)
    return out


def network_maker(converted: ConvertedKeras) -> Callable[[View, Scale], nn.Module]:
    """Return a function of a view and a scale that returns the converted network for them.

    There is one network for each scale, and all have the same tensors: views differ in the images,
    not in their shape.
    """
    networks: dict[Scale, nn.Module] = {}

    def make(view: View, scale: Scale) -> nn.Module:
        if scale not in networks:
            settings = _model_settings(converted, Combination(view, scale))
            network = make_network(settings, view).eval()
            network.load_state_dict(converted.state, assign=True)
            networks[scale] = network
        return networks[scale]

    return make


def _known(
    model: KerasModel, options: ImportOptions, searches: bool
) -> tuple[ConvertedKeras, KnownInput]:
    """Convert the model, and return what its file and the user's keys tell of its input."""
    scale = options.scale
    throttle, line = options.throttle_range, options.steering
    settings = (options.lambdas, options.outputs, options.size, throttle, line)
    try:
        converted = convert(model, scale, *settings)
        scale = converted.scale
    except InputError:
        if not searches or scale or options.lambdas:
            raise
        # An unclear Lambda may be the scale, which is then searched.
        converted = convert(model, SCALES[0], *settings)
    height, width, _ = converted.input_shape
    if options.size not in (None, (height, width)):
        raise InputError(
            f"size={typed(options.size)}: the input in {model.path} is {height} x {width}; leave "
            "size out"
        )
    if scale is None and not searches:
        raise InputError(
            f'{model.path}: does not tell how its pixels are scaled; set "scale=[127.5,1]" for '
            "x / 127.5 - 1, [255,0.5], [255,0] or [1,0], or recording=FOLDER to find it out"
        )
    facts = KnownInput(
        shape=converted.input_shape,
        colour=options.colour,
        crop=options.crop,
        resize=options.resize,
        scale=scale,
    )
    return converted, _as_donkeycar(facts) if model.is_donkeycar else facts


def _as_donkeycar(facts: KnownInput) -> KnownInput:
    """Return the input of a network of Donkeycar: the frame as it is, or one of 4 to 3 cropped."""
    rows, columns, channels = facts.shape
    frame = (3 * columns // 4, columns)
    crop = facts.crop or ((0, 0) if (rows, columns) in (frame, FRAME) else None)
    return replace(
        facts,
        colour=facts.colour or ("rgb" if channels == 3 else "gray"),
        crop=crop,
        resize=facts.resize or USUAL_RESIZE,
        frame=(rows, columns) if crop == (0, 0) else frame,
    )


def find_input(
    path: Path,
    converted: ConvertedKeras,
    facts: KnownInput,
    recording: Recording,
    options: ImportOptions,
    console: Console,
) -> Judgement:
    """Try inputs on a recording, drive those that are tied, print both, and return the judgement.

    Args:
        path: network's file, for the checkpoints that drive.
        converted: converted network.
        facts: facts about its input.
        recording: recording to try on.
        options: number of frames, and whether to drive.
        console: console that shows progress and results.

    Raises:
        InputError: an image cannot be read, or no input fits.
    """

    def show_best(trial: Trial) -> None:
        text = f"best so far: {trial.combination.text()}, correlation {trial.correlation:.2f}"
        console.print(text, highlight=False, markup=False, soft_wrap=True)

    def write(trial: Trial, out: Path) -> None:
        _write(out, path, converted, trial.combination, recording)

    with progress_bar("reading images", console) as show:
        frames = read_trial_frames(recording, options.frames, show)
    with progress_bar("trying colours and crops", console) as show:
        judged = search(network_maker(converted), facts, frames, show, show_best)
    if options.drive and other_car(recording) is None:
        judged = drive_tied(judged, write, console)
    console.print(trials_table(judged, console.width))
    (factor, offset), (before, shift) = judged.best.line, options.steering or (1.0, 0.0)
    again = _again(path, replace(options, steering=None))
    print_judgement(judged, (factor * before, factor * shift + offset), again, console)
    return judged


def _sources(facts: KnownInput, options: ImportOptions, rest: str) -> dict[str, str]:
    """Return where each part of the input came from."""
    keys = ("colour", "crop", "resize", "scale")
    sources = {key: FILE if getattr(facts, key) else rest for key in keys}
    sources |= {"size": FILE, "steering": KEY}
    return {key: KEY if getattr(options, key) else source for key, source in sources.items()}


def _again(path: Path, options: ImportOptions) -> list[object]:
    """Return the words of the command that replaces what is written now, with these options."""
    usual = vars(ImportOptions())
    words = [f"{key}={typed(value)}" for key, value in vars(options).items() if value != usual[key]]
    return ["drivezoo", "import", path, *words, "overwrite=true"]


def _warn_of_guesses(
    facts: KnownInput, guess: Combination, again: Sequence[object], console: Console
) -> None:
    keys = ["colour"] if facts.shape[:2] == FRAME else ["colour", "crop"]  # or the whole frame
    guessed = [
        f"{key}={typed(getattr(guess.view, key))}" for key in keys if getattr(facts, key) is None
    ]
    if guessed:
        are = "is a guess" if len(guessed) == 1 else "are guesses"
        text = f"warning: {' and '.join(guessed)} {are}: the file does not tell. Set them if you "
        text += f"know them, or find them out: {command_line(again)}"
        console.print(text, highlight=False, markup=False, soft_wrap=True)


def _model_settings(converted: ConvertedKeras, chosen: Combination) -> dict:
    """Return the section `model` of a config."""
    view = chosen.view.to_dict()
    return {
        "name": "keras",
        **{key: view[key] for key in ("colour", "size", "resize")},
        "weights": None,
        "_target_": "zoo.extras.keras.sequential.Sequential",
        "layers": converted.layers,
        "scale": list(chosen.scale),
    }


def _write(
    out: Path,
    path: Path,
    converted: ConvertedKeras,
    chosen: Combination,
    recording: Recording | None,
    source: str | None = None,
) -> dict:
    """Write a checkpoint, and return its facts on the recording.

    `source` names the network's car, where no recording does.
    """
    config = compose_config(["data=recording", "trainer.max_epochs=0"])
    config["model"] = _model_settings(converted, chosen) | {"weights": str(path)}
    config["data"] |= {
        "crop": list(chosen.view.crop),
        "root": recording.names[0] if recording else None,
    }
    data = {
        "fingerprint": recording.fingerprint() if recording else None,
        "rows": len(recording) if recording else 0,
    }
    if source := other_car(recording) if recording else source:
        data["source"] = source
    state = {f"{PREFIX}{name}": tensor for name, tensor in converted.state.items()}
    card = make_card(config, chosen.view, data)
    contents = {"drivezoo": card, "state_dict": state, IMPORTED: path.name}
    write_output(out, checkpoint_bytes(contents))
    return data
