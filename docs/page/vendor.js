// vendor.js - what the page takes of npm; scripts/dev/page.py bundles it, with the licences.
import { parquetMetadata, parquetRead, parquetSchema } from "hyparquet";
import { compressors } from "hyparquet-compressors";
import { parse } from "smol-toml";

export const parquet = { parquetMetadata, parquetRead, parquetSchema, compressors };
export const tomlReader = { parse };
