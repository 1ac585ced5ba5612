#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| psao_codec::fuzzing::surface_decode(data));
