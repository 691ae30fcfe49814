// Any datagram as a udp_multicast message. What ours takes for a frame, msgpack-c must read as one
// whole map, and packing the frame again must give the same frame. The other way round, the first
// bytes as a frame are packed and must come back.
#include <cmath>
#include <msgpack.hpp>

#include "fuzz/fuzz_target.hpp"
#include "realtime/udp_multicast_message.hpp"

namespace {

using eampc::control::Frame;
using eampc::fuzz::require;

bool same(const Frame& a, const Frame& b) noexcept {
  if (a.id != b.id || a.extended != b.extended || a.remote != b.remote || a.length != b.length) {
    return false;
  }
  return a.remote || std::equal(a.data.begin(), a.data.begin() + a.length, b.data.begin());
}

void check_repacked(const Frame& frame) noexcept {
  eampc::realtime::UdpMessage message;
  const std::size_t size = eampc::realtime::pack_udp_message(frame, 1.5, message);
  require(size <= message.size(), "a packed frame fits its buffer");
  const auto parsed = eampc::realtime::parse_udp_message(std::span(message).first(size));
  require(parsed && !parsed->is_error_frame && same(parsed->frame, frame),
          "a packed frame is read as it was");
}

void check_frame(const Frame& frame) noexcept {
  require(frame.length <= 8, "a frame has at most 8 bytes");
  require(frame.id < (frame.extended ? 1u << 29 : 1u << 11), "an identifier has 11 or 29 bits");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  eampc::fuzz::ByteReader bytes(data, size);
  Frame any;
  const auto kind = bytes.take<std::uint8_t>();
  any.extended = (kind & 1) != 0;
  any.remote = (kind & 2) != 0;
  any.length = std::min<std::uint8_t>(kind >> 4, 8);
  any.id = bytes.take<std::uint32_t>() % (any.extended ? 1u << 29 : 1u << 11);
  for (std::uint8_t& byte : any.data) byte = bytes.take<std::uint8_t>();
  check_repacked(any);

  const auto parsed = eampc::realtime::parse_udp_message({data, size});
  if (!parsed) return 0;
  check_frame(parsed->frame);
  std::size_t used = 0;
  const auto map = msgpack::unpack(reinterpret_cast<const char*>(data), size, used);
  require(used == size && map->type == msgpack::type::MAP,
          "msgpack-c reads the same bytes as one map");
  if (!parsed->is_error_frame) check_repacked(parsed->frame);
  return 0;
}
