import { Loader, Object3D } from "three";
import type { LoadingManager } from "three";
import type { LookupTables, SurfaceBake, Weights } from "./index.js";

/** Loads .gsgi files: `scene.add(await new GsgiLoader().loadAsync("room.gsgi"))`. */
export class GsgiLoader extends Loader<IndirectLight> {
    constructor(manager?: LoadingManager);

    /**
     * The light in the bytes of a file, read in a worker where there are any, so that the page goes on meanwhile. Throws
     * FormatError, and RangeError for the operator `over`.
     */
    parseAsync(data: ArrayBuffer): Promise<IndirectLight>;
}

/**
 * The light of a bake. While it is in a scene, all standard, physical, Lambert, Phong and toon materials of the meshes
 * there show it, those with `userData.gsgiMoves` as what moves, and was not in the scene when it was baked. Removing it, or
 * dispose(), leaves all materials as they were. Throws RangeError for the operator `over`.
 */
export class IndirectLight extends Object3D {
    /** `tables`: those of lookupTables(bake), which the light keeps and changes. */
    constructor(bake: SurfaceBake, tables: LookupTables);
    readonly bake: SurfaceBake;

    /** Factor on the light; 1 by default. */
    intensity: number;

    /**
     * Factors on the light of the file's light groups, by name, from the next frame on; 1 for those that are left out.
     * To set them takes a sum over the groups and an upload. Throws RangeError for an unknown group.
     */
    get weights(): Record<string, number | Iterable<number>>;
    set weights(weights: Weights);

    /** Bring the scene's materials up to date. Each render() does; call it yourself before renderer.compile(). */
    update(): void;

    /** Leave the scene, and free the GPU memory. */
    dispose(): void;
}
