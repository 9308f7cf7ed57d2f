/**
 * What the server sends and the page keeps, as types only.
 *
 * @typedef {"integer" | "number" | "boolean" | "choice" | "pair"} Kind
 * @typedef {{name: string, label: string, help: string, kind: Kind, default: string, choices: string[] | null,
 *   optional: boolean, least: number | null, most: number | null, slider: boolean}} Parameter of a preset or a request
 * @typedef {{name: string, signed: boolean, title: string, parameters: Parameter[]}} Preset
 * @typedef {{id: string, name: string, width: number, height: number, box?: Box | null,
 *   focal?: number | null, own?: boolean}} PhotoInfo own: a file of the reader's
 * @typedef {{id: string, name: string}} Named
 * @typedef {{version: string, default_preset: string, presets: Preset[], samples: PhotoInfo[], meshes: Named[],
 *   priors: {signed: boolean, unsigned: boolean}, limits: {upload_bytes: number, see_size: number, invert_size: number},
 *   options: {[view: string]: Parameter[]}}} About
 *
 * @typedef {{[name: string]: string}} Settings values of parameters that differ from their defaults
 * @typedef {{preset: string, settings: Settings}} Dialect
 * @typedef {{command: string, python: string}} Snippets
 * @typedef {[number, number, number, number]} Box x0, y0, x1, y1 in pixels
 *
 * @typedef {{id: string, name: string, template: boolean, parts: Named[], shape: number[], preset: string,
 *   image_size: [number, number] | null, decided_by: string, remark: string}} DescriptorInfo
 *   remark: what its numbers say against what was asked for
 * @typedef {{preset: string, settings: {[name: string]: string}, image_size: [number, number] | null}} FittingPreset
 * @typedef {{keys: string[] | null, shape: number[] | null, weights: boolean, fitting: FittingPreset[]}} Question
 *   weights: whether it may be those of a detector
 *
 * @typedef {{rows: number, cols: number, cell: [number, number], image: string}} Glyphs cell: height and width, pixels
 * @typedef {{key: string, name: string, shape: number[], numbers: number, signed: boolean, image_size: [number, number],
 *   glyphs: Glyphs, milliseconds: number, snippets: Snippets}} Hog
 * @typedef {{row: number, col: number, box: Box, angles: number[], histogram: number[] | null,
 *   block: {row: number, col: number, box: Box} | null, entries: {index: number, name: string, value: number}[]}} Cell
 *
 * @typedef {{image_size: [number, number], most: number | null, photograph: string | null}} InvertStart
 * @typedef {{evaluations: number, most: number | null, distance: number, cc: number | null, ssim: number | null,
 *   image: string}} InvertFrame
 * @typedef {{image: string, id: string, distance: number, cc: number | null, mi: number | null, ssim: number | null,
 *   psnr: number | null, polarity: number | null, negative: string | null, faded: string | null, evaluations: number,
 *   stop_reason: string, seconds: number, history: number[], snippets: Snippets, definitions: {[name: string]: string}}} InvertDone
 *
 * @typedef {{svg: string, description: string, across: number[]}} SimilarityChart across: shares of its width, of 0° and 360°
 * @typedef {number[]} Pose azimuth, elevation, distance, theta, x, y
 */
export {};
