#include "control/encoder_codec.hpp"

#include "control/frame_codec.hpp"

namespace eampc::control {
namespace {

std::uint64_t counter_mask(const SignalLayout& counter) noexcept {
  return counter.length >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << counter.length) - 1;
}

bool in_range(const SignalLayout& layout, double value) noexcept {
  return value >= layout.minimum && value <= layout.maximum;
}

}  // namespace

EncoderSample EncoderCodec::decode(const Frame* frame) noexcept {
  EncoderSample sample;
  if (frame == nullptr || frame->id != layout_.id || frame->extended != layout_.extended) {
    return sample;
  }
  if (frame->remote || frame->length != layout_.length) {
    sample.verdict = SampleVerdict::kWrongLength;
    return sample;
  }
  if (layout_.crc.present && frame_crc(frame->data, layout_.length, layout_.crc) !=
                                 frame->data[static_cast<std::size_t>(layout_.crc.byte)]) {
    sample.verdict = SampleVerdict::kBadCrc;
    return sample;
  }
  std::uint64_t counter = 0;
  if (layout_.counter.present) {
    counter = extract_bits(frame->data, layout_.counter);
    if (counter_known_) {
      const std::uint64_t advance = (counter - last_counter_) & counter_mask(layout_.counter);
      if (advance == 0) {
        sample.verdict = SampleVerdict::kDuplicate;
        return sample;
      }
      sample.missed_frames = static_cast<std::uint32_t>(advance - 1);
    }
  }
  sample.angle_rad = decode_signal(frame->data, layout_.angle);
  sample.has_velocity = layout_.velocity.present;
  if (sample.has_velocity) {
    sample.velocity_rad_s = decode_signal(frame->data, layout_.velocity);
  }
  if (layout_.status.present) {
    sample.status_raw = static_cast<std::uint32_t>(extract_bits(frame->data, layout_.status));
  }
  if (!in_range(layout_.angle, sample.angle_rad) ||
      (sample.has_velocity && !in_range(layout_.velocity, sample.velocity_rad_s))) {
    sample.verdict = SampleVerdict::kOutOfRange;
    sample.missed_frames = 0;
    return sample;
  }
  counter_known_ = layout_.counter.present;
  last_counter_ = counter;
  sample.verdict = SampleVerdict::kValid;
  return sample;
}

Frame encode_encoder_frame(const EncoderLayout& layout, double angle_rad, double velocity_rad_s,
                           std::uint64_t counter, std::uint64_t status_raw) noexcept {
  Frame frame;
  frame.id = layout.id;
  frame.extended = layout.extended;
  frame.length = static_cast<std::uint8_t>(layout.length);
  encode_signal(frame.data, layout.angle, angle_rad);
  if (layout.velocity.present) {
    encode_signal(frame.data, layout.velocity, velocity_rad_s);
  }
  if (layout.counter.present) {
    insert_bits(frame.data, layout.counter, counter);
  }
  if (layout.status.present) {
    insert_bits(frame.data, layout.status, status_raw);
  }
  if (layout.crc.present) {
    frame.data[static_cast<std::size_t>(layout.crc.byte)] =
        frame_crc(frame.data, layout.length, layout.crc);
  }
  return frame;
}

}  // namespace eampc::control
