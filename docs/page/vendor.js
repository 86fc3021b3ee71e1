// vendor.js - npm packages of the page; scripts/dev/page.py bundles them, with the
// licences.
import { parquetMetadata, parquetRead, parquetSchema } from "hyparquet";
import { compressors } from "hyparquet-compressors";
import { parse } from "smol-toml";

export const parquet = { parquetMetadata, parquetRead, parquetSchema, compressors };
export const tomlReader = { parse };
