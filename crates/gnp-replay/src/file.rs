//! The bytes of an `.rrd` file: messages, then a table of contents of the recording, which Rerun's
//! tools to check, list and load parts of a file use.
//!
//! Rerun's own encoder would list recording and layout, and the columns of each, in the order of a
//! random hash, so that the same clip would not give the same bytes.

use std::collections::HashMap;

use re_chunk::{Chunk, Span};
use re_log_encoding::{
    CodecError, CrateVersion, Encodable as _, EncodingOptions, MessageHeader, MessageKind, RRD_FOURCC, RrdFooter,
    RrdManifestBuilder, StreamFooter, StreamHeader, ToTransport as _,
};
use re_log_types::{LogMsg, StoreId};
use re_sdk_types::external::arrow::datatypes::Schema;

use crate::error::ReplayError;

const OPTIONS: EncodingOptions = EncodingOptions::PROTOBUF_COMPRESSED;

/// A file being written.
pub(crate) struct File {
    bytes: Vec<u8>,
    contents: RrdManifestBuilder,
}

impl File {
    /// Begins with the version.
    pub(crate) fn new() -> Result<Self, ReplayError> {
        let mut bytes = Vec::new();
        let header = StreamHeader { fourcc: RRD_FOURCC, version: CrateVersion::LOCAL.to_bytes(), options: OPTIONS };
        header.to_rrd_bytes(&mut bytes).map_err(failed)?;
        Ok(Self { bytes, contents: RrdManifestBuilder::default() })
    }

    /// A message that is not listed at the end.
    pub(crate) fn message(&mut self, message: &LogMsg) -> Result<(), ReplayError> {
        let transport = message.to_transport(OPTIONS.compression).map_err(failed)?;
        transport.to_rrd_bytes(&mut self.bytes).map_err(failed)?;
        Ok(())
    }

    /// A chunk of the recording, which is listed.
    pub(crate) fn recorded(&mut self, recording: &StoreId, chunk: &Chunk) -> Result<(), ReplayError> {
        let refused = |error: CodecError| refused(chunk, error);
        let start = self.bytes.len() as u64 + MessageHeader::ENCODED_SIZE_BYTES as u64;
        let transport = packed(recording, chunk)?.to_transport(OPTIONS.compression).map_err(refused)?;
        transport.to_rrd_bytes(&mut self.bytes).map_err(refused)?;
        let span = Span::from_start_len(start, self.bytes.len() as u64 - start);
        let batch = chunk.to_chunk_batch().map_err(|error| crate::file::refused(chunk, error))?;
        self.contents.append(&batch, span, transport.byte_size_uncompressed()).map_err(refused)
    }

    /// Ends with the table of contents.
    pub(crate) fn finish(self, recording: &StoreId) -> Result<Vec<u8>, ReplayError> {
        let Self { mut bytes, contents } = self;
        let mut manifest = contents.build(recording.clone()).map_err(failed)?;
        let mut columns = manifest.sorbet_schema.fields().to_vec();
        columns.sort();
        manifest.sorbet_schema = Schema::new_with_metadata(columns, manifest.sorbet_schema.metadata);
        let footer = RrdFooter { manifests: HashMap::from([(recording.clone(), manifest)]) };
        let mut content = Vec::new();
        footer.to_transport(()).and_then(|footer| footer.to_rrd_bytes(&mut content)).map_err(failed)?;
        let header = MessageHeader { kind: MessageKind::End, len: content.len() as u64 };
        header.to_rrd_bytes(&mut bytes).map_err(failed)?;
        let start = bytes.len() as u64;
        bytes.extend_from_slice(&content);
        StreamFooter::from_rrd_footer_bytes(start, &content).to_rrd_bytes(&mut bytes).map_err(failed)?;
        Ok(bytes)
    }
}

/// A chunk as a message.
pub(crate) fn packed(store: &StoreId, chunk: &Chunk) -> Result<LogMsg, ReplayError> {
    let message = chunk.to_arrow_msg().map_err(|error| refused(chunk, error))?;
    Ok(LogMsg::ArrowMsg(store.clone(), message))
}

fn refused(chunk: &Chunk, error: impl std::error::Error + Send + Sync + 'static) -> ReplayError {
    ReplayError::Entity { entity: chunk.entity_path().to_string(), source: Box::new(error) }
}

fn failed(error: CodecError) -> ReplayError {
    ReplayError::File(Box::new(error))
}
