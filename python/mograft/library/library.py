"""The class `Library`: build, store and open libraries of segments."""

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.library.derive import DerivableLibrary
from mograft.library.discover import ClipSource
from mograft.library.files.storage import load_library, read

# Imported where they are used: opening a library needs neither readers nor writers.
if TYPE_CHECKING:
    from mograft.library.data import Columns
    from mograft.library.ingest_run import AddOptions, IngestOptions

Paths = str | PathLike[str] | Iterable[str | PathLike[str]]


@dataclass(frozen=True, eq=False, repr=False)
class Library(DerivableLibrary):
    """Clips of one skeleton, cut into segments that are compared and clustered by joint group.

    `Library.build` builds a library in memory, `Library.index` builds one in a folder, and
    `Library.open` opens the folder.

    Attributes
    ----------
    clips : sequence of Motion
        The clips, of one hierarchy and one frame rate; offsets may differ. A clip of a library in
        a folder is read when it is accessed.
    entries : tuple of ClipInfo
        Metadata of each clip: name, source file, source rate, faults, tags.
    segments : Segments
        The segments of all clips, clip by clip in order of time.
    is_donor : ndarray of bool, shape (n_segments,)
        Whether each segment may be a donor. Segments that overlap certain recording faults may not.
    groups : JointGroups
        The joint groups.
    config : Config
        The configuration with which the library was built.
    spec : LibrarySpec
        The parameters that all clips share: `skeleton`, `rate`, `root`, `up`, `match` and `rest`.
    embedding : dict of str to Embedding or None
        For each group the segments as points; None if the segments are too few or too alike.
    labels : dict of str to ndarray of int, shape (n_segments,)
        For each group the cluster of each segment; clusters are numbered from 0 in the order of
        their first members.
    sigma : dict of str to float
        For each group the cluster diameter threshold.
    boundary_states : dict of str to dict of str to ndarray
        For each group the poses and velocities of its joints in the first and last frame of
        each segment, as in `BoundaryStates`.
    samples : Samples or JoinedSamples
        The resampled segments from which features are computed.
    refused : dict of str to str
        The reason for each file or clip that was left out, by address.
    folder : Path or None
        The folder of the library; None in memory.

    Notes
    -----
    For a library in a folder, `pickle` stores no arrays of the folder. It stores the path, the
    checksum, and the calls of `relabelled` and `with_clip` by which the library was derived.
    Unpickling opens the folder and repeats the calls. It raises FileNotFoundError if the folder is
    missing, and LibraryError if the library in the folder has changed. A library in memory is
    pickled with all arrays.
    """

    @classmethod
    def build(
        cls,
        sources: ClipSource | Iterable[ClipSource],
        groups: JointGroups | str = "lower_upper",
        config: Config | None = None,
        *,
        mirrored: bool = False,
        strict: bool = True,
        **options: "Unpack[IngestOptions]",
    ) -> "Library":
        """Build a library in memory.

        Parameters
        ----------
        sources : Motion, address, folder or glob, or several
            The clips. An address is a path, which stands for all clips of a file, or
            ``path#clip``, in which ``clip`` may be a glob. The files of a folder or glob are in
            order of name.
        groups : JointGroups or str
            The joint groups, the name of a preset, or ``auto`` or ``auto:3``, which discovers them
            in the clips; see `mograft.discover_groups`. The library stores the discovered groups.
        config : Config, optional
            The configuration.
        mirrored : bool
            Whether to append the mirror images of all clips; see `with_mirror_images`.
        strict : bool
            Whether a clip that cannot be read or does not fit is an error. Otherwise it is left
            out and listed in `refused`.
        include_grafts : bool
            Whether to include grafts: files in folders beside which ``mograft graft`` wrote a
            ``.json``, and clips that have their provenance in a GLB or NPZ file. By default they
            are left out, unless an address names the file or the clip exactly.
        rate : float, optional
            Frames per second of the library. Default: the rate that most frames have.
        match : {"names", "anatomy"}
            How clips of different hierarchies fit together. With "names", the default, all clips
            must have the same joint names and hierarchy. With "anatomy", clips of other hierarchies
            are converted to the one that most clips have: joints correspond by body part, side and
            order along the limb, joints without a counterpart stay at rest or are dropped, and a
            warning lists them. Bones keep their lengths, apart from a conversion of units.
        hierarchy : Skeleton, optional
            With ``match="anatomy"``, the skeleton to whose joints all clips are converted.
        skeleton : Skeleton, optional
            The rest pose of files that store none, such as those of AMASS; see `read`.
        frame_rates : mapping of str to float, optional
            The true frames per second of clips whose file gives a wrong rate, by name,
            file name, or a glob that matches either.
        tags : mapping of str to iterable of str, optional
            Words by which donors can be chosen, by the same keys as `frame_rates`; the
            folders between a source and a file are tags, too.
        executor : concurrent.futures.Executor, optional
            The workers that read, segment and sample clips: a pool of threads or of processes,
            or ``dask.distributed.Client.get_executor()``. Workers must have access to the
            files. The result does not depend on the executor. Default: the calling thread.
        progress : callable, optional
            Called with the name of a stage, the number of items done and the number of all items.

        Raises
        ------
        FormatError, FileNotFoundError
            If a file is invalid; if a path, folder or glob holds no file.
        SkeletonMismatchError
            If the clips differ in joint names or hierarchy, or cannot be matched by anatomy.
        ValueError
            If an option is invalid, there is no clip, the groups do not fit the skeleton, or a clip
            has a single frame.

        Warns
        -----
        UserWarning
            If clips are matched by anatomy, are resampled to the library's rate or have faults such
            as a T-pose in the first frame, if the segments of a group are too few or too alike to
            cluster, or if grafts in folders are left out.

        Examples
        --------
        >>> from mograft.dancer import dance
        >>> library = Library.build(dance(strides=1).motion)
        >>> sorted(library.labels)
        ['lower', 'upper']
        """
        from mograft.library.build import build_library
        from mograft.library.ingest_run import IngestPlan

        config = Config() if config is None else config
        plan = IngestPlan(config=config, groups=groups, strict=strict, **options)
        library = build_library(cls, sources, plan)
        return library.with_mirror_images() if mirrored else library

    @classmethod
    def index(
        cls,
        sources: Paths,
        path: str | PathLike[str],
        groups: JointGroups | str = "lower_upper",
        config: Config | None = None,
        *,
        strict: bool = False,
        force: bool = False,
        **options: "Unpack[IngestOptions]",
    ) -> "Library":
        """Build a library in a folder.

        Clips are read and written one at a time. The memory that grows with the library is that of
        the points, the clusters and the table of segments.

        Parameters
        ----------
        sources : path, folder or glob, or several
            The files, in any order: the clips of the library are sorted by path.
        path : path
            The folder to create.
        groups, config, include_grafts, rate, match, hierarchy, skeleton, frame_rates, tags, \
executor, progress
            As for `build`.
        strict : bool
            Whether a clip that cannot be read or does not fit is an error. By default it is
            left out and listed in `refused`.
        force : bool
            Whether to replace an existing library.

        Returns
        -------
        Library
            The new library, opened. If it replaces another one, that one stays valid until the new
            one is complete.

        Raises
        ------
        FileExistsError
            If the library exists.
        LibraryError
            If the folder is not a library, or another process is writing to it.
        ValueError
            If the groups do not fit the skeleton, or no clip can be used.
        FormatError, FileNotFoundError, SkeletonMismatchError
            As for `build`; for single clips only with `strict`.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from mograft import write_bvh
        >>> from mograft.dancer import dance
        >>> with TemporaryDirectory() as folder:
        ...     write_bvh(dance(strides=1).motion, f"{folder}/dance.bvh")
        ...     library = Library.index(folder, f"{folder}/dance.mograft")
        ...     library.entries[0].name, len(library.clips)
        ('dance', 1)
        """
        from mograft.library.indexing import index_folder
        from mograft.library.ingest_run import IngestPlan

        config = Config() if config is None else config
        plan = IngestPlan(config=config, groups=groups, strict=strict, is_packed=True, **options)
        index_folder(Path(path), sources, plan, force=force)
        return cls.open(path)

    def add(
        self, sources: Paths, *, strict: bool = False, **options: "Unpack[AddOptions]"
    ) -> "Library":
        """Add clips to a library in a folder.

        Parameters
        ----------
        sources : path, folder or glob, or several
            The files. Files that the library holds and that have not changed are not read.
        strict, include_grafts, frame_rates, tags, executor, progress
            As for `index`.

        Returns
        -------
        Library
            The new state of the library: the one that `index` would have built from all files.
            This object keeps its state.

        Raises
        ------
        LibraryError
            If the library is damaged, or another process is writing to it.
        ValueError
            If the library is in memory, or no clip can be used.
        TypeError
            If `rate`, `match`, `hierarchy` or `skeleton` is given, which are fixed when a library
            is created.
        FormatError, FileNotFoundError, SkeletonMismatchError
            As for `index`.

        Notes
        -----
        A file counts as unchanged if its size and modification time are the same, or if its SHA-256
        is. Clips whose files were removed stay in the library. Clips that a changed file no longer
        contains are removed, with a warning.
        """
        from mograft.library.indexing import add_to_folder
        from mograft.library.ingest_run import IngestPlan

        if self.folder is None:
            raise ValueError("the library is in memory: save it first, or build it from all clips")
        for name in ("rate", "match", "hierarchy", "skeleton"):
            if name in options:
                raise TypeError(f"`{name}` is fixed when a library is created")
        plan = IngestPlan(config=self.config, strict=strict, is_packed=True, **options)
        add_to_folder(self.folder, sources, plan)
        return Library.open(self.folder)

    def save(self, path: str | PathLike[str], *, force: bool = False) -> None:
        """Write the library to a folder.

        Parameters
        ----------
        path : path
            The folder to create.
        force : bool
            Whether to replace an existing library.

        Raises
        ------
        FileExistsError
            If the library exists.
        LibraryError
            If the folder is not a library, or another process is writing to it.
        ValueError
            If a clip was appended by `with_clip`, or the segmentation is a function.

        Notes
        -----
        `open` then returns a library with the same numbers, bit for bit. Clips of a library in
        memory are stored at the library's rate, clips of an opened library as read from their
        files.
        """
        from mograft.library.files.generation import save_library

        save_library(self, Path(path), force=force)

    def table(self) -> "Columns":
        """Return the table of all segments, with contacts, phases and copies.

        All clips are read, and compared.

        Returns
        -------
        dict of str to ndarray
            The columns of `to_dataframe`; before them ``id``, a number that depends only on the
            path of the file (relative to the folder of the library), the clip in it and the first
            frame, so that it stays when clips are added; after them ``contact_JOINT``, the share of
            frames in which the foot of the ankle JOINT is in contact; ``phase``, that of the stride
            in the first frame: 0 at a contact of the left foot, 0.5 at one of the right, NaN where
            the feet do not alternate; and ``twin``, the ``id`` of the first other segment that is a
            copy in all groups, 0 if there is none.

        Examples
        --------
        >>> from mograft.dancer import dance
        >>> table = Library.build(dance(strides=1).motion).table()
        >>> [name for name in table if name.startswith("contact")]
        ['contact_LeftFoot', 'contact_RightFoot']
        """
        from mograft.library.segment_table import segment_table

        return segment_table(self)

    @classmethod
    def open(cls, path: str | PathLike[str]) -> "Library":
        """Open a library in a folder.

        Parameters
        ----------
        path : path
            The folder.

        Returns
        -------
        Library
            A library with memory-mapped arrays. It does not change when another process adds clips.

        Raises
        ------
        LibraryError
            If the folder is not a mograft library, is damaged, was written by a newer version or
            is rewritten repeatedly while it is read.
        FileNotFoundError
            If the folder does not exist.
        """
        return load_library(cls, read(Path(path)))
