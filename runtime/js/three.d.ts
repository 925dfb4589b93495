import { Loader, Object3D } from "three";
import type { LoadingManager } from "three";
import type { LookupTables, SurfaceBake } from "./index.js";

/** Loads .gsgi files: `scene.add(await new GsgiLoader().loadAsync("room.gsgi"))`. */
export class GsgiLoader extends Loader<IndirectLight> {
    constructor(manager?: LoadingManager);

    /** The light in the bytes of a file. Throws FormatError, and RangeError for the operator `over`. */
    parse(data: ArrayBuffer): IndirectLight;

    /** The same in a worker where there are any, so that the page goes on meanwhile. */
    parseAsync(data: ArrayBuffer): Promise<IndirectLight>;
}

/**
 * The light of a bake. While it is in a scene, all standard, physical, Lambert, Phong and toon materials of the meshes
 * there show it. Removing it, or dispose(), leaves all materials as they were. Throws RangeError for the operator
 * `over`.
 */
export class IndirectLight extends Object3D {
    /** `tables`: those of lookupTables(bake), where they are at hand. */
    constructor(bake: SurfaceBake, tables?: LookupTables);
    readonly bake: SurfaceBake;

    /** Factor on the light; 1 by default. */
    intensity: number;

    /** Bring the scene's materials up to date. Each render() does; call it yourself before renderer.compile(). */
    update(): void;

    /** Leave the scene, and free the GPU memory. */
    dispose(): void;
}
